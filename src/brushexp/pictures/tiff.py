"""Read TIFF files with tifffile if Pillow misreads them, cannot read them, or loses precision."""

import io
import math
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import IO, Any, Literal

import numpy as np
from PIL import Image, TiffImagePlugin
from PIL.ImageFile import ImageFile
from PIL.TiffImagePlugin import TiffImageFile

from brushexp.errors import UserError
from brushexp.pictures.carriers import Colors
from brushexp.pictures.kinds import CURE, DAMAGED, RAW, SENSOR
from brushexp.pictures.limits import MAX_PIXELS, check_pixels
from brushexp.pictures.srgb import (
    ORIENTATION,
    bytes_to_srgb,
    floats_to_srgb,
    unit_range,
    upright,
    valid_orientation,
)
from brushexp.pictures.tiff_directories import (
    BIG,
    BITS,
    COMPRESSION,
    FILL_ORDER,
    LAST_BIT_FIRST,
    PHOTOMETRIC,
    SUB_IFDS,
    directories,
    directories_below,
    first_directory,
    main_directory,
)

PLANES, COLOR_MAP, PREDICTOR, SAMPLE_FORMAT, PROFILE = 284, 320, 317, 339, 34675  # TIFF tags
UNPACKED = (1, 8, 32773, 32946)  # COMPRESSION that tifffile reads by itself: none, deflate, PackBits
PACKINGS = {  # other values, and their names
    **dict.fromkeys((2, 3, 4), "CCITT fax"),
    **dict.fromkeys((6, 7, 99), "JPEG"),
    **dict.fromkeys((33003, 33004, 33005, 34712), "JPEG 2000"),
    **dict.fromkeys((50002, 52546), "JPEG XL"),
    **{5: "LZW", 34887: "LERC", 34925: "LZMA", 34926: "Zstandard", 50000: "Zstandard", 34927: "WebP", 50001: "WebP"},
}
RARE = (34887, 34925, 34926, 34927, 50000, 50001, 50002, 52546)  # values that some builds of libtiff do not support
WHOLE_BITS = (1, 8, 16, 32, 64)  # bits per sample that tifffile reads without other packages
FLOATING = 3  # value of PREDICTOR
WHITE_IS_ZERO, BLACK_IS_ZERO, RGB, PALETTE, CMYK = 0, 1, 2, 3, 5  # values of PHOTOMETRIC
CHANNELS = {WHITE_IS_ZERO: 1, BLACK_IS_ZERO: 1, RGB: 3, PALETTE: 1, CMYK: 4}  # number of colour channels
SIGNED = 2  # value of SAMPLE_FORMAT
ASSOCIATED, UNASSOCIATED = 1, 2  # kinds of extra TIFF channels: alpha with premultiplied colours, and straight alpha
ROWS = 256  # rows averaged at once
LARGEST_PIECE = 2**28  # largest number of samples in a strip or tile that is unpacked at once
EIGHT_BIT = 256  # a colour map whose numbers are all smaller has 8 bits, as in libtiff, though the standard demands 16


def needs_tifffile(picture: ImageFile) -> bool:
    """Check whether tifffile has to decode a TIFF, because Pillow misreads it or cannot hold all its bits or pixels."""
    if not isinstance(picture, TiffImageFile):
        return False
    tags = picture.tag_v2
    bits = max(tags.get(BITS, (1,)))
    needs = codec_needs(tags.get(COMPRESSION, 1), bits, tags.get(PREDICTOR, 1))
    unpacked = not needs or has_codecs()
    if bits <= 8 and SIGNED not in tags.get(SAMPLE_FORMAT, ()):
        return unpacked and math.prod(picture.size) > MAX_PIXELS
    if picture.mode == "F" and not unpacked:
        return False  # Pillow reads grey floats with libtiff
    return unpacked or tags.get(PLANES) == 2 or tags.get(PHOTOMETRIC) == WHITE_IS_ZERO or picture.mode == "I"


def codec_needs(compression: int, bits: int, predictor: int) -> list[str]:
    """List the reasons why tifffile needs the imagecodecs package to read a page; empty if it does not."""
    needs = []
    if compression not in UNPACKED:
        needs.append(f"packed as {PACKINGS.get(compression, f'compression {compression}')}")
    if bits not in WHOLE_BITS:
        needs.append(f"of {bits} bits per sample")
    if predictor == FLOATING:
        needs.append("of floats with a predictor")
    return needs


def has_codecs() -> bool:
    """Check whether imagecodecs, which lets tifffile unpack more formats, is installed."""
    return find_spec("imagecodecs") is not None


def is_rarely_packed(picture: ImageFile) -> bool:
    """Check whether Pillow may be unable to decompress a TIFF; raise a UserError if no installed package can."""
    compression = picture.tag_v2.get(COMPRESSION, 1) if isinstance(picture, TiffImageFile) else 1
    if compression in RARE and not has_codecs():
        needs = f"packed as {PACKINGS[compression]}, which needs a decoder; pip install 'brushexp[tiff]'"
        raise UserError(f"is a TIFF {needs}; if the decoder is installed, the file is damaged: get it again")
    return compression in RARE


def restore_byte_order(samples: np.ndarray, picture: Image.Image) -> np.ndarray:
    """Restore the byte order of a TIFF's floats, because Pillow swaps the bytes again after libtiff has done so."""
    is_exchanged = isinstance(picture, TiffImageFile) and picture.use_load_libtiff and picture.tag_v2.prefix == b"MM"
    return samples.byteswap() if is_exchanged and samples.dtype.kind == "f" else samples


@contextmanager
def libtiff_only() -> Iterator[None]:
    """Make Pillow read TIFF files only with libtiff within the ``with`` block."""
    TiffImagePlugin.READ_LIBTIFF = True
    try:
        yield
    finally:
        TiffImagePlugin.READ_LIBTIFF = False


def is_misread(path: Path) -> bool:
    """Check whether Pillow would mistake tiles for strips, strips for tiles, or the last bit for the first."""
    first = first_directory(path)
    return first is not None and (first.mixes_tiles_with_strips or first.number(FILL_ORDER) == LAST_BIT_FIRST)


def mend_palette(picture: Image.Image) -> None:
    """Correct the palette of a TIFF with an 8-bit colour map, which turns black because Pillow expects 16 bits."""
    if not isinstance(picture, TiffImageFile) or picture.mode not in ("P", "PA"):
        return
    numbers = picture.tag_v2.get(COLOR_MAP, ())
    if numbers and max(numbers) < EIGHT_BIT:
        picture.load()
        picture.putpalette(np.array(numbers, np.uint8).reshape(3, -1).T.tobytes())


def main_page(path: Path, picture: ImageFile) -> IO[bytes] | None:
    """Open a TIFF at its main picture if a smaller copy precedes it; otherwise return None.

    A TIFF that contains raw sensor data raises a UserError.
    """
    first = first_directory(path) if isinstance(picture, TiffImageFile) else None
    if first is None or not (first.is_reduced or SUB_IFDS in first.numbers):
        return None
    pages = (page for top in directories(path) for page in (top, *directories_below(path, top)))
    if any(page.number(PHOTOMETRIC) in SENSOR for page in pages):
        raise UserError(RAW)
    chosen = main_directory(path)
    if chosen is None or chosen.place == first.place:
        return None
    file = bytearray(path.read_bytes())  # a copy in which the chosen page comes first
    at, order = _place_of_first_page(file)
    file[at] = chosen.place.to_bytes(at.stop - at.start, order)
    return io.BytesIO(file)


def _place_of_first_page(head: bytes | bytearray) -> tuple[slice, Literal["little", "big"]]:
    return slice(8, 16) if BIG in head[2:4] else slice(4, 8), "little" if head[:1] == b"I" else "big"


def pages_in(path: Path) -> int:
    """Count the pages of a TIFF up to the first damaged one, excluding smaller copies of other pages."""
    return sum(not page.is_reduced for page in directories(path))


def read_tiff(file: Path | IO[bytes], backdrop: float, colors: Colors, side: int | None) -> np.ndarray:
    """Decode the first page as `read_picture` does; ``colors`` take precedence over the page's own profile.

    Pages above 100 megapixels are averaged to at least ``side`` pixels on the longer side.
    """
    from tifffile import TiffFile, TiffPage  # noqa: PLC0415  (rarely needed)

    if not isinstance(file, Path):
        file.seek(0)
    with TiffFile(file, is_lsm=False) as tiff:  # otherwise it follows all pages, even in circles
        page = tiff.pages[0]
        assert isinstance(page, TiffPage)
        check_pixels(page.imagewidth, page.imagelength, "TIFF", side)
        if not all(isinstance(number, int) for number in (page.compression, page.bitspersample, page.predictor)):
            raise UserError(DAMAGED)
        n_colors = _colors_in(page)
        needs = codec_needs(page.compression, page.bitspersample, page.predictor)
        if needs and not has_codecs():
            raise UserError(f"is a TIFF {' and '.join(needs)}, which needs a decoder; pip install 'brushexp[tiff]'")
        if math.prod(page.chunked) > len(page.dataoffsets):  # tifffile would fill in each missing piece
            raise UserError("is damaged: some rows are missing; get the whole file")
        samples = _samples(page, side)
        orientation, profile = (page.tags.valueof(code) for code in (ORIENTATION, PROFILE))
    if samples.dtype.kind not in "buf":
        raise UserError(f"is a TIFF of signed or complex numbers; {CURE}")
    colors = colors or profile
    if page.photometric == CMYK:
        rgb: np.ndarray = bytes_to_srgb(Image.fromarray(samples[..., :4], "CMYK"), colors, backdrop)
        return upright(rgb, valid_orientation(orientation))
    unit = unit_range(samples, page.bitspersample)
    color = 1 - unit[..., :1] if page.photometric == WHITE_IS_ZERO else unit[..., :n_colors]
    if page.photometric == PALETTE:
        color = _palette_of(page)[samples[..., 0].astype(int)]
    extra = next(iter(page.extrasamples), None)
    alpha = unit[..., n_colors : n_colors + 1] if extra in (ASSOCIATED, UNASSOCIATED) else None
    if alpha is not None and extra == ASSOCIATED:
        color = np.divide(color, alpha, out=np.ones_like(color), where=alpha > 0).clip(0, 1)
    return upright(floats_to_srgb(color, alpha, colors, backdrop), valid_orientation(orientation))


def _palette_of(page: Any) -> np.ndarray:
    """Read the palette (N, 3), in [0, 1], of a page whose samples are indices into it."""
    numbers = np.asarray(page.colormap)
    levels = numbers if numbers.max() < EIGHT_BIT else numbers >> 8
    return levels.T.astype(np.float32) / 255


def _colors_in(page: Any) -> int:
    """Count the colour channels of a page; raise a UserError for unsupported colour types."""
    if page.photometric == CMYK and page.bitspersample != 8:
        raise UserError(f"is a CMYK TIFF with {page.bitspersample} bits per colour; save it with 8 bits, or as RGB")
    count = CHANNELS.get(page.photometric, 0)
    is_counted = count <= page.samplesperpixel <= max(count + 1, 4) and page.axes in ("YX", "YXS", "SYX")
    is_averaged = page.imagewidth * page.imagelength > MAX_PIXELS  # indices into a palette cannot be averaged
    if not count or not is_counted or (is_averaged and page.photometric == PALETTE):
        raise UserError(f"is a TIFF that is neither grey nor RGB; {CURE}")
    return count


def _samples(page: Any, side: int | None) -> np.ndarray:
    """Read the samples (H, W, C) of a page; if the page is too large, they are averaged over squares of pixels."""
    if page.imagewidth * page.imagelength > MAX_PIXELS:
        return _means(page, side or 1)
    samples = np.atleast_3d(page.asarray())
    return np.moveaxis(samples, 0, 2) if page.axes == "SYX" else samples


def _means(page: Any, side: int) -> np.ndarray:
    height, width = page.imagelength, page.imagewidth
    k = max(max(height, width) // side, math.ceil(math.sqrt(height * width / MAX_PIXELS)))
    sums = np.zeros((-(-height // k), -(-width // k), page.samplesperpixel), np.float32)
    for top, left, plane, piece in _pieces(page):
        down, right = (
            (np.arange(at // k, -(-(at + n) // k)) * k - at).clip(0)
            for at, n in ((top, piece.shape[0]), (left, piece.shape[1]))
        )
        means = np.add.reduceat(np.add.reduceat(piece.astype(np.float32), down, 0), right, 1)
        place = sums[top // k :, left // k :, plane:]
        place[: means.shape[0], : means.shape[1], : means.shape[2]] += means
    rows, columns = (
        np.minimum(k, n - k * np.arange(count)) for n, count in ((height, sums.shape[0]), (width, sums.shape[1]))
    )
    sums /= (rows[:, None] * columns)[..., None]
    return sums if page.dtype.kind in "bf" else np.rint(sums).astype(page.dtype)


def _pieces(page: Any) -> Iterator[tuple[int, int, int, np.ndarray]]:
    """Yield the row, column, first channel and samples (h, w, C) of each part of a page."""
    if page.is_memmappable and page.axes != "SYX":
        file = page.parent.filehandle
        whole = file.memmap_array(page.parent.byteorder + page.dtype.char, page.shape, page.dataoffsets[0])
        for top in range(0, page.imagelength, ROWS):
            yield top, 0, 0, np.atleast_3d(whole[top : top + ROWS])
        return
    if math.prod(page.chunks) > LARGEST_PIECE:
        raise UserError(f"has strips of more than {LARGEST_PIECE >> 20} million samples; save it in tiles")
    for data, (plane, _, top, left, _), (_, height, width, _) in page.segments(maxworkers=1):
        if data is not None:
            within = slice(min(height, page.imagelength - top)), slice(min(width, page.imagewidth - left))
            yield top, left, plane, data[0][within]
