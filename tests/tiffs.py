"""TIFF files of any layout, assembled byte by byte to resemble those of scanners, microscopes and old programs."""

import struct
import zlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

HEIGHT, WIDTH = 37, 45
NONE, DEFLATE, OLD_DEFLATE, PACKBITS = 1, 8, 32946, 32773  # values of Compression
WHITE_IS_ZERO, BLACK_IS_ZERO, RGB, PALETTE, CMYK = 0, 1, 2, 3, 5  # values of PhotometricInterpretation
BYTE, SHORT, LONG, LONG8 = 1, 3, 4, 16  # types of values
SIZES, FORMS = {BYTE: 1, SHORT: 2, LONG: 4, LONG8: 8}, {BYTE: "B", SHORT: "H", LONG: "I", LONG8: "Q"}
Tag = tuple[int, int, Sequence[int]]  # number, type and values


@dataclass(frozen=True)
class Layout:
    """The layout of a picture's samples in a TIFF file."""

    bits: int = 8
    photometric: int = RGB
    is_big_endian: bool = False
    is_big: bool = False  # BigTIFF
    compression: int = NONE
    is_planar: bool = False
    rows: int = 10  # per strip
    tile: tuple[int, int] | None = None  # width and height of tiles, instead of strips
    swaps_names: bool = False  # tiles use the tags of strips, or strips those of tiles
    last_bit_first: bool = False
    predictor: int = 1
    tags: tuple[Tag, ...] = ()  # additional tags
    without: tuple[int, ...] = ()  # omitted tags

    @property
    def order(self) -> str:
        return ">" if self.is_big_endian else "<"


def ramps(channels: int, bits: int) -> np.ndarray:
    """Make smooth gradients (H, W, C) of ``bits``-bit integers."""
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH]
    x, y = x / (WIDTH - 1), y / (HEIGHT - 1)
    shares = [x, y, (x + y) / 2, 1 - x / 2]
    return np.stack([np.rint(share * (2**bits - 1)).astype(np.int64) for share in shares[:channels]], -1)


def tiff(samples: np.ndarray, layout: Layout) -> bytes:
    """Encode samples (H, W, C) as a one-page TIFF."""
    pieces = [_packed(piece, layout) for piece in _pieces(samples, layout)]
    return _file(_tags(samples.shape, pieces, layout), pieces, layout)


def _pieces(samples: np.ndarray, layout: Layout) -> Iterable[np.ndarray]:
    planes = [samples[..., k : k + 1] for k in range(samples.shape[2])] if layout.is_planar else [samples]
    for plane in planes:
        if layout.tile is None:
            yield from (plane[top : top + layout.rows] for top in range(0, len(plane), layout.rows))
            continue
        width, height = layout.tile
        for top in range(0, plane.shape[0], height):
            for left in range(0, plane.shape[1], width):
                piece = plane[top : top + height, left : left + width]
                yield np.pad(piece, ((0, height - piece.shape[0]), (0, width - piece.shape[1]), (0, 0)))


def _packed(piece: np.ndarray, layout: Layout) -> bytes:
    if layout.predictor == 2:
        piece = np.diff(piece, axis=1, prepend=0) % 2**layout.bits
    rows = piece.reshape(len(piece), -1)
    if layout.predictor == 3:  # the first bytes of all numbers, then the second ones, ..., as differences (Adobe, 2005)
        planes = rows.astype(">u4").view(np.uint8).reshape(*rows.shape, 4).swapaxes(1, 2).reshape(len(rows), -1)
        data = np.diff(planes, axis=1, prepend=np.uint8(0)).tobytes()
    elif layout.bits in (8, 16, 32):
        data = rows.astype(f"{layout.order}u{layout.bits // 8}").tobytes()
    else:
        digits = (rows[..., None] >> np.arange(layout.bits - 1, -1, -1)) & 1
        data = np.packbits(digits.astype(np.uint8).reshape(len(rows), -1), axis=1).tobytes()
    if layout.last_bit_first:
        data = np.packbits(np.unpackbits(np.frombuffer(data, np.uint8)), bitorder="little").tobytes()
    if layout.compression == PACKBITS:
        return b"".join(bytes([len(part) - 1]) + part for part in (data[k : k + 128] for k in range(0, len(data), 128)))
    return data if layout.compression == NONE else zlib.compress(data)


def _tags(shape: tuple[int, ...], pieces: Sequence[bytes], layout: Layout) -> list[Tag]:
    height, width, channels = shape
    tags: list[Tag] = [(256, SHORT, [width]), (257, SHORT, [height]), (258, SHORT, [layout.bits] * channels)]
    tags += [(259, SHORT, [layout.compression]), (262, SHORT, [layout.photometric]), (277, SHORT, [channels])]
    tags += [(284, SHORT, [2 if layout.is_planar else 1])]
    tags += [(266, SHORT, [2])] * layout.last_bit_first + [(317, SHORT, [layout.predictor])] * (layout.predictor != 1)
    if layout.tile is None:
        tags.append((278, SHORT, [layout.rows]))
    else:
        tags += [(322, SHORT, layout.tile[:1]), (323, SHORT, layout.tile[1:])]
    places, lengths = (324, 325) if (layout.tile is not None) != layout.swaps_names else (273, 279)
    kind = LONG8 if layout.is_big else LONG
    tags += [(places, kind, [0] * len(pieces)), (lengths, kind, [len(piece) for piece in pieces])]
    return sorted(tag for tag in (*tags, *layout.tags) if tag[0] not in layout.without)


def _file(tags: Sequence[Tag], pieces: Sequence[bytes], layout: Layout) -> bytes:
    order, offset = layout.order, "Q" if layout.is_big else "I"
    mark = b"MM" if layout.is_big_endian else b"II"
    head = mark + (struct.pack(order + "HHHQ", 43, 8, 0, 16) if layout.is_big else struct.pack(order + "HI", 42, 8))
    entry, inline = (20, 8) if layout.is_big else (12, 4)
    at = len(head) + struct.calcsize(order + ("Q" if layout.is_big else "H")) + entry * len(tags) + inline
    outside = {tag: values for tag, kind, values in tags if SIZES[kind] * len(values) > inline}
    places: dict[int, int] = {}
    for tag, kind, values in tags:
        if tag in outside:
            places[tag] = at
            at += SIZES[kind] * len(values)
    starts = []
    for piece in pieces:
        starts.append(at)
        at += len(piece)
    listed, behind = struct.pack(order + ("Q" if layout.is_big else "H"), len(tags)), b""
    for tag, kind, values in tags:
        numbers = starts if tag in (273, 324) else values
        data = struct.pack(f"{order}{len(numbers)}{FORMS[kind]}", *numbers)
        listed += struct.pack(order + "HH" + offset, tag, kind, len(numbers))
        listed += struct.pack(order + offset, places[tag]) if tag in outside else data.ljust(inline, b"\0")
        behind += data if tag in outside else b""
    return head + listed + bytes(inline) + behind + b"".join(pieces)


def chain(pages: int, back_to: int | None) -> bytes:
    """Make a TIFF of 16 x 16 grey pages whose last page links back to page ``back_to``, or to no page."""
    tags = [(256, 16), (257, 16), (258, 8), (259, 1), (262, 1), (273, 0), (278, 16), (279, 256)]
    length = 2 + 12 * len(tags) + 4
    data = 8 + pages * length
    file = b"II*\0" + struct.pack("<I", 8)
    for number in range(pages):
        following = 8 + (number + 1) * length if number + 1 < pages else 0
        if number + 1 == pages and back_to is not None:
            following = 8 + back_to * length
        file += struct.pack("<H", len(tags))
        file += b"".join(struct.pack("<HHII", tag, LONG, 1, value or data) for tag, value in tags)
        file += struct.pack("<I", following)
    return file + bytes(range(256))
