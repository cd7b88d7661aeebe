"""Decode picture files in many formats to display-referred sRGB."""

import logging
import os
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from functools import cache
from pathlib import Path
from typing import IO, NamedTuple

import numpy as np
from PIL import Image, UnidentifiedImageError
from PIL.ImageFile import ImageFile
from PIL.JpegImagePlugin import JpegImageFile
from PIL.TiffImagePlugin import TiffImageFile

from brushexp.errors import UserError
from brushexp.pictures.boxes import Crop
from brushexp.pictures.carriers import Colors, colors_of
from brushexp.pictures.cut_short import SOME_MISSING, allow_truncated, check_missing, has_end, open_truncated
from brushexp.pictures.damage import check_sums, remark_on
from brushexp.pictures.jp2 import bits_of, check_decoder, read_jp2
from brushexp.pictures.kinds import (
    CURE,
    FILM,
    FORMATS,
    HEAD,
    RAW,
    WITH_CODECS,
    check_not_raw,
    codec_for,
    has_codec,
    is_raw,
    is_special,
    what_it_is,
)
from brushexp.pictures.limits import alone, check_pixels, check_whole, halvings, open_of_any_size, size_of_jxl
from brushexp.pictures.packing import remark_on_packing
from brushexp.pictures.second_opinion import remark_of_others
from brushexp.pictures.shape import clean_aperture, pixel_aspect, resample, size_in_square_pixels
from brushexp.pictures.srgb import SWAPPED, bytes_to_srgb, floats_to_srgb, orientation_of, unit_range, upright
from brushexp.pictures.tiff import (
    is_misread,
    is_rarely_packed,
    libtiff_only,
    main_page,
    mend_palette,
    needs_tifffile,
    pages_in,
    read_tiff,
    restore_byte_order,
)
from brushexp.pictures.tiff_directories import BITS, LENGTH, MAGIC, WIDTH
from brushexp.system.reading import check_file, explaining

log = logging.getLogger(__name__)
WRITTEN = ("JPEG", "PNG", "WEBP")  # formats that runs write
MOVING = ("AVIF", "GIF", "PNG", "WEBP")  # formats that may be animated
MOVES = "is animated, and only its first frame is used; to paint it as a film, type: brushexp {}"
PAGES = "has {} pages, and only the first is used; save the others as separate files"
JPEG_HALVINGS = 3  # maximum


def read_picture(path: Path, *, key: str = "image", backdrop: float = 1.0, side: int | None = None) -> np.ndarray:
    """Decode a picture's first frame to upright sRGB, composited over a ``backdrop`` of white (1) or black (0).

    The result is (H, W, 3) uint8, or float32 in [0, 1] if more than 8 bits are kept. Only 8 bits are kept for 16-bit
    PNG files other than plain grey ones, for CMYK, and for TIFF files that only Pillow can unpack. All colour
    information is applied: an ICC profile (in 8 bits, unless it is broken), ITU-T H.273 code points, gamma and
    primaries, or a camera's Adobe RGB setting. The picture is resampled to square pixels. Pictures above 100 megapixels
    are read at a smaller size, with at least ``side`` pixels on the longer side. Truncated files, animations and
    further pages are logged once. Pictures that cannot be read, are too large, or have floats outside [0, 1] raise a
    UserError that names the ``key`` of the path.
    """
    with _explain_errors(path, key):
        pixels, remark = _read(path, backdrop, side)
    if remark:
        _tell(f"{key}={path} {remark}")
    return np.ascontiguousarray(pixels)


@cache
def _tell(line: str) -> None:
    log.warning(line)


def picture_size(path: Path, *, key: str = "image") -> tuple[int, int]:
    """Determine a readable picture's height and width, usually from its first and last bytes."""
    with _explain_errors(path, key), _open_and_check(path, 1) as (_, picture):
        if picture is None:
            return _read(path, 1.0, None)[0].shape[:2]
        width, height = picture.size
        if isinstance(picture, TiffImageFile):
            width, height = (picture.tag_v2[tag] for tag in (WIDTH, LENGTH))
        check_decoder(picture)
        is_whole = has_end(path)
        if not is_whole or isinstance(picture, TiffImageFile):  # much of a TIFF is not read here
            _read(path, 1.0, 1)
        with nullcontext() if is_whole else allow_truncated():
            declared = read_declared(picture)
            is_swapped = orientation_of(picture) >= SWAPPED
    if declared.crop is not None:
        height, width = (part.stop - part.start for part in declared.crop)
    if is_swapped:
        width, height = height, width
    return size_in_square_pixels(height, width, declared.aspect)


class Declared(NamedTuple):
    """Properties that a picture file declares about its pixels."""

    colors: Colors
    aspect: float  # width over height of a pixel in the upright picture
    crop: Crop | None  # visible part of the picture before it is turned; None for all of it


def read_declared(picture: Image.Image) -> Declared:
    """Read the properties that a picture declares; call this before decoding, because some decoders close the file."""
    return Declared(colors_of(picture), pixel_aspect(picture), clean_aperture(picture))


@contextmanager
def _explain_errors(path: Path, key: str) -> Iterator[None]:
    """Convert any error raised for a picture to a UserError that names the key and the file."""
    with _silence():
        try:
            yield
            return
        except UserError as error:
            reason = str(error)
        except UnidentifiedImageError:
            reason = _describe_unknown(path)
        except Exception as error:  # decoders raise a dozen kinds of errors
            if isinstance(error, OSError) and error.strerror:
                reason = f"cannot be read ({error.strerror.lower()}); give a file that you have permission to read"
            else:
                log.debug("%s", path, exc_info=True)
                reason = _explain_failure(path)
    raise UserError(f"{key}={path} {reason}")


def _explain_failure(path: Path) -> str:
    """Explain why a file in a known format cannot be decoded."""
    with path.open("rb") as file:
        kind = what_it_is(file.read(HEAD))
    if is_special(kind):
        return kind
    if (end := has_end(path)) is False:
        return SOME_MISSING
    state = "damaged" if end else "truncated, damaged"  # some formats do not mark the end of a file
    return f"is {state} or cannot be decoded here; get it again, or {CURE}"


def _describe_unknown(path: Path) -> str:
    """Describe a file that no decoder recognised, and say what the user can do."""
    if is_raw(str(path)):
        return RAW
    with path.open("rb") as file:
        words = what_it_is(file.read(HEAD))
    return SOME_MISSING if words != FILM and has_end(path) is False else words


@contextmanager
def open_picture(path: Path) -> Iterator[Image.Image]:
    """Open a run's picture without decoding it; any error is raised as a UserError."""
    check_file(path, "paint it again")
    with explaining(path, "paint it again"), open_of_any_size(path, WRITTEN) as picture:
        check_pixels(*picture.size, "", None)
        yield picture


@contextmanager
def _silence() -> Iterator[None]:
    """Suppress decoder messages on the terminal; decoders raise errors for serious problems.

    `check_pixels` replaces Pillow's own limit on pixels.
    """
    with alone, open(os.devnull, "w") as nowhere, warnings.catch_warnings(action="ignore"):
        stderr, level, most = os.dup(2), logging.root.manager.disable, Image.MAX_IMAGE_PIXELS
        logging.disable(logging.CRITICAL)
        os.dup2(nowhere.fileno(), 2)  # libtiff, a C library, writes to it
        Image.MAX_IMAGE_PIXELS = None
        try:
            yield
        finally:
            os.dup2(stderr, 2)
            os.close(stderr)
            logging.disable(level)
            Image.MAX_IMAGE_PIXELS = most


@contextmanager
def _open_and_check(path: Path, side: int | None) -> Iterator[tuple[Path | IO[bytes], ImageFile | None]]:
    """Open a picture and check it before decoding; the picture is None for a TIFF that Pillow does not recognise."""
    with path.open("rb") as file:
        head = file.read(HEAD)
    if not head:
        raise UserError("is empty (0 bytes); give a file that holds a picture")
    _load_codec(head)
    check_sums(path)
    is_tiff = head[:4] in MAGIC
    try:
        with libtiff_only() if is_tiff and is_misread(path) else nullcontext():
            picture = Image.open(path)
    except UnidentifiedImageError:
        if not is_tiff or is_raw(str(path)):
            raise
        yield path, None
        return
    with picture:
        if picture.format not in FORMATS and picture.format not in WITH_CODECS:
            raise UserError(f"has the format {picture.format}, which is not supported; {CURE}")
        check_not_raw(picture, head)
        page = main_page(path, picture)
        with nullcontext(picture) if page is None else Image.open(page) as main:
            check_pixels(*main.size, main.format or "", side)
            yield page or path, main


def _load_codec(head: bytes) -> None:
    """Register the decoder for a picture, given its first bytes; raise a UserError that names a missing extra."""
    extra = codec_for(head)
    if extra and not has_codec(extra):
        name = {extra: kind for kind, extra in WITH_CODECS.items()}[extra]
        raise UserError(f"has the format {name}, which needs a decoder; pip install 'brushexp[{extra}]'")
    if extra == "jxl":  # this codec decodes when it opens a file
        check_pixels(*size_of_jxl(head), "JXL", None)


def _read(path: Path, backdrop: float, side: int | None) -> tuple[np.ndarray, str]:
    """Decode a picture and collect warnings about it."""
    with _open_and_check(path, side) as (file, picture):
        if picture is None:
            return read_tiff(path, backdrop, None, side), ""
        remark, count = _of_several(path, picture), picture.width * picture.height
        try:
            declared = read_declared(picture)
            pixels = _to_square_pixels(_decode(file, picture, declared, backdrop, side), declared.aspect)
            damage = remark_on_packing(path) or remark_of_others(path, picture.format or "", count)
            remarks = (remark, damage, remark_on(pixels))
            return pixels, "; it ".join(filter(None, remarks))
        except UserError:
            raise
        except (OSError, ValueError, SyntaxError):
            if is_rarely_packed(picture):
                return _to_square_pixels(read_tiff(file, backdrop, declared.colors, side), declared.aspect), remark
            if (again := open_truncated(path, picture.format or "")) is None:
                raise
    with again, allow_truncated():
        declared = read_declared(again)
        draft(again, side)
        again.load()
        remark = check_missing(again)
        return _to_square_pixels(_to_srgb(again, declared, backdrop), declared.aspect), remark


def _of_several(path: Path, picture: ImageFile) -> str:
    """Return a warning if a file has several frames or pages; return "" if it contains a single picture."""
    if isinstance(picture, TiffImageFile):
        count = pages_in(path)
        return PAGES.format(count) if count > 1 else ""
    return MOVES.format(path) if picture.format in MOVING and getattr(picture, "n_frames", 1) > 1 else ""


def _to_square_pixels(pixels: np.ndarray, aspect: float) -> np.ndarray:
    height, width = pixels.shape[:2]
    return resample(pixels, size_in_square_pixels(height, width, aspect))


def _decode(
    file: Path | IO[bytes], picture: ImageFile, declared: Declared, backdrop: float, side: int | None
) -> np.ndarray:
    """Decode an opened picture with a library that handles it correctly."""
    colors = declared.colors
    if needs_tifffile(picture):
        return read_tiff(file, backdrop, colors, side)
    if isinstance(file, Path) and (bits := bits_of(picture)):
        deep = floats_to_srgb(*read_jp2(file, picture, bits, side), colors, backdrop)
        return upright(deep, orientation_of(picture))
    draft(picture, side)
    return _to_srgb(picture, declared, backdrop)


def draft(picture: ImageFile, side: int | None) -> None:
    """Prepare a picture above 100 megapixels for decoding at a smaller size, at least ``side`` on its longer side."""
    width, height = picture.size
    if isinstance(picture, JpegImageFile):
        if "progressive" in picture.info:  # all of its coefficients would be in memory
            check_whole(width, height)
        times = 2 ** halvings(width, height, side or 1, JPEG_HALVINGS)
        if times > 1:
            picture.draft(picture.mode, (width // times, height // times))
    else:
        check_whole(width, height, picture.mode.startswith("I"))


def decode_image(picture: Image.Image, backdrop: float = 1.0, declared: Declared | None = None) -> np.ndarray:
    """Decode a Pillow image as `read_picture` does; Pillow's decoder may raise any error.

    ``declared`` is the result of `read_declared`, obtained before the file's first picture was decoded.
    """
    check_not_raw(picture)
    declared = declared or read_declared(picture)
    return _to_square_pixels(_to_srgb(picture, declared, backdrop), declared.aspect)


def _to_srgb(picture: Image.Image, declared: Declared, backdrop: float) -> np.ndarray:
    mend_palette(picture)
    if picture.mode == "F" or picture.mode.startswith("I"):
        samples, key = restore_byte_order(np.asarray(picture), picture)[..., None], picture.info.get("transparency")
        alpha = None if key is None else (samples != key).astype(np.float32)
        bits = max(picture.tag_v2.get(BITS, (16,))) if isinstance(picture, TiffImageFile) else 16
        rgb = floats_to_srgb(unit_range(samples, bits), alpha, declared.colors, backdrop)
    else:
        rgb = bytes_to_srgb(picture, declared.colors, backdrop)
    shown = rgb if declared.crop is None else rgb[declared.crop]
    # Pillow turns only TIFFs when it loads them.
    return shown if isinstance(picture, TiffImageFile) else upright(shown, orientation_of(picture))
