"""Detect damage by counting the pixels in compressed data, because LZW, run-length coding and JPEG have no checksum.

A flipped bit usually changes the length of the data that follow. Decoders do not notice this, because they stop at the
last pixel and ignore the rest.
"""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from brushexp.compat.compiled import function
from brushexp.pictures.cut_short import END_OF_JPEG
from brushexp.pictures.jpeg_codes import START, jpeg_fits
from brushexp.pictures.tiff_directories import (
    BITS,
    COMPRESSION,
    FILL_ORDER,
    JPEG_TABLES,
    LAST_BIT_FIRST,
    LENGTH,
    MAGIC,
    PHOTOMETRIC,
    TILE_WIDTH,
    WIDTH,
    Directory,
    main_directory,
)

MISCOUNTED = "may be damaged: its compressed pixels do not fit its size; compare it with another copy"
LZW, JPEG, PACKBITS = 5, 7, 32773  # values of COMPRESSION in a TIFF
YCBCR = 6  # value of PHOTOMETRIC with which some channels have fewer pixels
SAMPLES, ROWS_PER_STRIP, PLANES, TILE_LENGTH = 277, 278, 284, 323  # tags of a TIFF
SEPARATE = 2  # value of PLANES
EARLY = 1  # TIFF widens its codes one code before the table is full, GIF does not
MOST_CODES = 4096
INVALID = -1  # length of data that no encoder writes
QOI, QOI_HEAD, QOI_END = b"qoif", 14, 8  # first bytes of a QOI, and bytes of its head and its end marker
TGA_HEAD, TGA_RUNS, TGA_FOOTER = 18, (9, 10, 11), b"TRUEVISION-XFILE.\0"  # bytes; run-length types; last bytes
GIF, GIF_HEAD, IMAGE, EXTENSION = b"GIF8", 13, 0x2C, 0x21


@function
def lzw_length(data: np.ndarray, bits: int, last_bit_first: bool, early: int) -> int:
    """Count the samples encoded in LZW data (bytes) with ``bits`` per sample; return `INVALID` for an invalid code."""
    lengths = np.ones(MOST_CODES, dtype=np.int64)
    clear = 1 << bits
    width, following, before, total = bits + 1, clear + 2, -1, 0
    held, count = 0, 0  # bits that have been read but not used
    for k in range(len(data)):
        byte = int(data[k])
        held = held | (byte << count) if last_bit_first else (held << 8) | byte
        count += 8
        while count >= width:
            count -= width
            code = held & ((1 << width) - 1) if last_bit_first else held >> count
            held = held >> width if last_bit_first else held & ((1 << count) - 1)
            if code == clear + 1:
                return total
            if code == clear:
                width, following, before = bits + 1, clear + 2, -1
                continue
            if code > following or (before < 0 and code > clear):
                return INVALID
            length = lengths[before] + 1 if code == following else lengths[code]
            if before >= 0 and following < MOST_CODES:
                lengths[following] = lengths[before] + 1
                following += 1
                if following == (1 << width) - early and width < 12:
                    width += 1
            total += length
            before = code
    return total


def remark_on_packing(path: Path) -> str:
    """Return a warning if a file contains more or fewer pixels than its header states; return "" if it seems intact."""
    with path.open("rb") as file:
        head = file.read(18)
    if head[:4] in MAGIC:
        main = main_directory(path)
        is_whole = main is None or (_jpegs_fit(path, main) and _tiff_is_whole(path, main))
    elif head.startswith(START):
        is_whole = jpeg_fits(path.read_bytes())
    elif head[:4] == QOI:
        is_whole = _qoi_is_whole(path.read_bytes())
    elif head[:4] == GIF:
        is_whole = _gif_is_whole(path.read_bytes())
    elif path.suffix.lower() == ".tga" and head[2:3] and head[2] in TGA_RUNS:
        is_whole = _tga_is_whole(path.read_bytes())
    else:
        return ""
    return "" if is_whole else MISCOUNTED


def _jpegs_fit(path: Path, page: Directory) -> bool:
    """Check whether the JPEG data in each strip or tile of a TIFF match its size."""
    pieces = page.pieces() if page.number(COMPRESSION) == JPEG else []
    tables = bytes(page.numbers.get(JPEG_TABLES, ()))[: -len(END_OF_JPEG)] or START
    with path.open("rb") as file:
        for place, length in pieces:
            file.seek(place + len(START))
            if not jpeg_fits(tables + file.read(length - len(START))):
                return False
    return True


def _tiff_is_whole(path: Path, page: Directory) -> bool:
    """Check whether the LZW or PackBits strips or tiles of a TIFF are complete."""
    packing, pieces = page.number(COMPRESSION), page.pieces()
    is_odd = page.number(FILL_ORDER) == LAST_BIT_FIRST or page.number(PHOTOMETRIC) == YCBCR
    if packing not in (LZW, PACKBITS) or is_odd or not pieces:
        return True
    samples = 1 if page.number(PLANES) == SEPARATE else page.number(SAMPLES) or 1
    bits = samples * (page.number(BITS) or 1)
    row = -(-(page.number(TILE_WIDTH) or page.number(WIDTH)) * bits // 8)
    height, rows = page.number(LENGTH), page.number(TILE_LENGTH) or page.number(ROWS_PER_STRIP)
    rows = min(rows or height, height) if TILE_WIDTH not in page.numbers else rows
    last = height - (height - 1) // rows * rows  # rows of the last strip, which may be padded
    with path.open("rb") as file:
        for place, length in pieces:
            file.seek(place)
            packed = file.read(length)
            if packing == LZW and packed[:1] == b"\0" and packed[1:2] and packed[1] & 1:
                return True  # packing from before TIFF 6.0
            found = lzw_length(np.frombuffer(packed, np.uint8), 8, False, EARLY) if packing == LZW else _runs(packed)
            if found not in (row * rows, row * last):
                return False
    return True


def _runs(packed: bytes) -> int:
    """Count the unpacked bytes of PackBits data; return `INVALID` if the last run is incomplete."""
    total = at = 0
    while at < len(packed):
        count = packed[at]
        at += 1
        if count < 128:
            at += count + 1
            total += count + 1
        elif count > 128:
            at += 1
            total += 257 - count
    return total if at == len(packed) else INVALID


def _qoi_is_whole(data: bytes) -> bool:
    """Check whether the operations in a QOI file produce exactly its pixels and end where the file ends."""
    pixels, at = int.from_bytes(data[4:8]) * int.from_bytes(data[8:12]), QOI_HEAD
    end = len(data) - QOI_END
    while pixels > 0 and at < end:
        first = data[at]
        pixels -= (first & 63) + 1 if 0xC0 <= first < 0xFE else 1
        at += {0xFE: 4, 0xFF: 5}.get(first, 2 if first >> 6 == 2 else 1)
    return pixels == 0 and at == end


def _gif_is_whole(data: bytes) -> bool:
    """Check whether the first picture of a GIF unpacks to all its pixels."""
    at = GIF_HEAD + _colors(data[10])
    while at < len(data) and data[at] == EXTENSION:
        at += 2 + sum(len(block) + 1 for block in _blocks(data, at + 2)) + 1
    if at + 10 >= len(data) or data[at] != IMAGE:
        return False
    width, height = (int.from_bytes(data[k : k + 2], "little") for k in (at + 5, at + 7))
    at += 10 + _colors(data[at + 9])
    packed = b"".join(_blocks(data, at + 1))
    return 1 <= data[at] <= 8 and lzw_length(np.frombuffer(packed, np.uint8), data[at], True, 0) == width * height


def _colors(flags: int) -> int:
    """Return the size of a GIF colour table in bytes."""
    return 3 << (flags & 7) + 1 if flags & 128 else 0


def _blocks(data: bytes, at: int) -> Iterator[bytes]:
    while at < len(data) and (length := data[at]):
        yield data[at + 1 : at + 1 + length]
        at += 1 + length


def _tga_is_whole(data: bytes) -> bool:
    """Check whether the runs in a TGA produce exactly its pixels, and whether only a footer follows them."""
    entries, bits = int.from_bytes(data[5:7], "little"), data[7]
    pixels = int.from_bytes(data[12:14], "little") * int.from_bytes(data[14:16], "little")
    at, size = TGA_HEAD + data[0] + data[1] * entries * -(-bits // 8), -(-data[16] // 8)
    while pixels > 0 and at < len(data):
        count = (data[at] & 127) + 1
        at += 1 + size * (1 if data[at] & 128 else count)
        pixels -= count
    return pixels == 0 and (at == len(data) or (at < len(data) and data.endswith(TGA_FOOTER)))
