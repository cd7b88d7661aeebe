"""TIFF files that Pillow misreads, cannot read, or reads too coarsely are read by tifffile."""

import io
import math
from collections.abc import Iterable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import IO, Any, Literal

import numpy as np
from PIL.ImageFile import ImageFile
from PIL.TiffImagePlugin import TiffImageFile

from brushexp.errors import UserError
from brushexp.pictures.carriers import Colors
from brushexp.pictures.kinds import CURE, PHOTOMETRIC, RAW, REDUCED, SENSOR, SUB_IFDS, SUBFILE
from brushexp.pictures.limits import MAX_PIXELS, check_pixels
from brushexp.pictures.srgb import ORIENTATION, floats_to_srgb, unit_range, upright

WIDTH, LENGTH, BITS, COMPRESSION, PLANES, SAMPLE_FORMAT, PROFILE = 256, 257, 258, 259, 284, 339, 34675  # TIFF tags
UNPACKED = (1, 8, 32946)  # values of COMPRESSION that tifffile reads by itself: none and deflate
WHITE_IS_ZERO, BLACK_IS_ZERO, RGB, CMYK = 0, 1, 2, 5  # values of PHOTOMETRIC
SIGNED = 2  # value of SAMPLE_FORMAT
ASSOCIATED, UNASSOCIATED = 1, 2  # what an extra TIFF channel is: alpha that colours are, or are not, multiplied with
ROWS = 256  # of a picture that is averaged, at once
LARGEST_PIECE = 2**28  # samples of a strip or a tile that is unpacked at once
BIG = b"+"  # third or fourth byte of a BigTIFF


def needs_tifffile(picture: ImageFile) -> bool:
    """Decide whether tifffile can unpack a TIFF of too many bits or pixels for Pillow, or one that it misreads."""
    if not isinstance(picture, TiffImageFile):
        return False
    tags = picture.tag_v2
    unpacked = tags.get(COMPRESSION, 1) in UNPACKED
    if max(tags.get(BITS, (1,))) <= 8 and SIGNED not in tags.get(SAMPLE_FORMAT, ()):
        return unpacked and math.prod(picture.size) > MAX_PIXELS
    return unpacked or tags.get(PLANES) == 2 or tags.get(PHOTOMETRIC) == WHITE_IS_ZERO or picture.mode == "I"


def main_page(path: Path, picture: ImageFile) -> IO[bytes] | None:
    """Open a TIFF at its picture if a smaller copy of that comes first, else None.

    A UserError refuses one in which the picture is what a sensor saw.
    """
    tags = picture.tag_v2 if isinstance(picture, TiffImageFile) else {}
    if not tags.get(SUBFILE, 0) & REDUCED and SUB_IFDS not in tags:
        return None
    from tifffile import TiffFile  # noqa: PLC0415  (rarely needed)

    with TiffFile(path) as tiff:
        pages: list[Any] = [page for top in tiff.pages for page in (top, *(top.pages or ()))]
    if any(page.photometric in SENSOR for page in pages):
        raise UserError(RAW)
    whole = [page for page in pages if not page.subfiletype & REDUCED]
    chosen = whole[0] if whole else max(pages, key=lambda page: page.imagewidth * page.imagelength)
    if not pages[0].subfiletype & REDUCED or chosen is pages[0]:
        return None
    file = bytearray(path.read_bytes())  # in which that page comes first
    at, order = _place_of_first_page(file)
    file[at] = chosen.offset.to_bytes(at.stop - at.start, order)
    return io.BytesIO(file)


def first_page(head: bytes) -> int:
    """Read where the first page of a TIFF is described from its first 16 bytes."""
    at, order = _place_of_first_page(head)
    return int.from_bytes(head[at], order)


def _place_of_first_page(head: bytes | bytearray) -> tuple[slice, Literal["little", "big"]]:
    return slice(8, 16) if BIG in head[2:4] else slice(4, 8), "little" if head[:1] == b"I" else "big"


def pages_in(path: Path) -> int:
    """Count the pages of a TIFF that are no smaller copies of others; 1 if it is damaged."""
    from tifffile import TiffFile  # noqa: PLC0415  (rarely needed)

    with suppress(Exception), TiffFile(path) as tiff:  # damaged tags raise nearly anything
        pages: Iterable[Any] = tiff.pages
        return sum(not page.subfiletype & REDUCED for page in pages)
    return 1


def read_tiff(file: Path | IO[bytes], backdrop: float, colors: Colors, side: int | None) -> np.ndarray:
    """Decode the first page as `read_picture` does; ``colors`` count before a profile of the page.

    One of more than 100 megapixels is averaged to at least ``side`` pixels on its longer side.
    """
    from tifffile import TiffFile, TiffPage  # noqa: PLC0415  (rarely needed)

    if not isinstance(file, Path):
        file.seek(0)
    with TiffFile(file) as tiff:
        page = tiff.pages[0]
        assert isinstance(page, TiffPage)
        check_pixels(page.imagewidth, page.imagelength, "TIFF", side)
        n_colors = _colors_in(page)
        if math.prod(page.chunked) > len(page.dataoffsets):  # each would be made up, one by one
            raise UserError("is damaged or cannot be decoded (rows are missing); get the whole file")
        samples = _samples(page, side)
        orientation, profile = (page.tags.valueof(code) for code in (ORIENTATION, PROFILE))
    if samples.dtype.kind not in "uf":
        raise UserError(f"is a TIFF of signed or complex numbers; {CURE}")
    unit = unit_range(samples, page.bitspersample)
    color = 1 - unit[..., :1] if page.photometric == WHITE_IS_ZERO else unit[..., :n_colors]
    extra = next(iter(page.extrasamples), None)
    alpha = unit[..., n_colors : n_colors + 1] if extra in (ASSOCIATED, UNASSOCIATED) else None
    if alpha is not None and extra == ASSOCIATED:
        color = np.divide(color, alpha, out=np.ones_like(color), where=alpha > 0).clip(0, 1)
    return upright(floats_to_srgb(color, alpha, colors or profile, backdrop), orientation or 1)


def _colors_in(page: Any) -> int:
    """Count the colours of a page: 1 or 3; a UserError if it has others."""
    if page.photometric == CMYK:
        raise UserError(f"is a TIFF of CMYK with {page.bitspersample} bits a colour; save it with 8 bits, or as RGB")
    count = {WHITE_IS_ZERO: 1, BLACK_IS_ZERO: 1, RGB: 3}.get(page.photometric, 0)
    if not count or not count <= page.samplesperpixel <= 4 or page.axes not in ("YX", "YXS", "SYX"):
        raise UserError(f"is a TIFF that is neither grey nor RGB; {CURE}")
    return count


def _samples(page: Any, side: int | None) -> np.ndarray:
    """Read the samples (H, W, C) of a page, or of one that is too large their means over squares."""
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
    return sums if page.dtype.kind == "f" else np.rint(sums).astype(page.dtype)


def _pieces(page: Any) -> Iterator[tuple[int, int, int, np.ndarray]]:
    """Yield row, column and first channel of parts (h, w, C) of a page, and these."""
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
