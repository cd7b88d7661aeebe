"""Picture files of many formats are decoded to display-referred sRGB."""

import io
import logging
import math
import os
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from threading import RLock

import numpy as np
from PIL import Image, ImageCms, UnidentifiedImageError
from PIL.ImageFile import ImageFile
from PIL.TiffImagePlugin import TiffImageFile

from brushexp.errors import UserError
from brushexp.system.reading import check_file, explaining

MAX_PIXELS = 100_000_000  # in float32 RGB that many take 1.2 GB
# Raster formats only: for EPS, Pillow would start another program.
FORMATS = ("AVIF", "BMP", "DIB", "GIF", "JPEG", "JPEG2000", "MPO", "PNG", "PPM", "PSD", "QOI", "TGA", "TIFF", "WEBP")
WRITTEN = ("JPEG", "PNG", "WEBP")  # by runs
TIFF_MAGIC = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")
BITS, COMPRESSION, PHOTOMETRIC, ORIENTATION, PLANES, PROFILE = 258, 259, 262, 274, 284, 34675  # TIFF tags
UNPACKED = (1, 8, 32946)  # values of COMPRESSION that tifffile reads by itself: none and deflate
WHITE_IS_ZERO, BLACK_IS_ZERO, RGB = 0, 1, 2  # values of PHOTOMETRIC
ASSOCIATED, UNASSOCIATED = 1, 2  # what an extra TIFF channel is: alpha that colours are, or are not, multiplied with
SWAPPED = 5  # the first of the EXIF orientations, up to 8, that exchange rows and columns
CURE = "convert it to a PNG or a JPEG"
_alone = RLock()  # a process has one stderr, and one list of warnings


def read_picture(path: Path, *, key: str = "image", backdrop: float = 1.0) -> np.ndarray:
    """Decode the first frame of a picture, upright, over a ``backdrop`` of white (1) or black (0), in sRGB.

    It is (H, W, 3) uint8, or float32 in [0, 1] where more than 8 bits are kept; PNG of 16 bits other than plain grey,
    CMYK, and TIFF that Pillow alone can unpack keep 8. An embedded ICC profile is converted, to 8 bits, unless it is
    broken. UserError, with the ``key`` that the user types before the path, if the picture cannot be read, is too
    large, or has floats outside [0, 1].
    """
    with _explained(path, key):
        return np.ascontiguousarray(_read(path, backdrop))


def picture_size(path: Path, *, key: str = "image") -> tuple[int, int]:
    """Read height and width of a picture as `read_picture` decodes it, and its errors, from its first bytes."""
    with _explained(path, key), _opened(path) as picture:
        if picture is None or isinstance(picture, TiffImageFile):
            height, width = _read(path, 1.0).shape[:2]
        else:
            width, height = picture.size if _orientation(picture) < SWAPPED else picture.size[::-1]
    return height, width


@contextmanager
def _explained(path: Path, key: str) -> Iterator[None]:
    """Make whatever is wrong with a picture a UserError that names the key and the file."""
    with _silence():
        try:
            yield
            return
        except UserError as error:
            reason = str(error)
        except Image.DecompressionBombError:
            reason = _too_large(f"more than {2 * (Image.MAX_IMAGE_PIXELS or 0) // 10**6} megapixels")
        except UnidentifiedImageError:
            reason = f"is not a picture of a known format; {CURE}"
        except Exception as error:  # decoders have a dozen kinds
            if isinstance(error, OSError) and error.strerror:
                reason = f"cannot be read ({error.strerror.lower()}); give a file that you may read"
            else:
                words = " ".join(str(error).split()) or type(error).__name__
                reason = f"is damaged or cannot be decoded ({words}); {CURE}"
    raise UserError(f"{key}={path} {reason}")


@contextmanager
def open_picture(path: Path) -> Iterator[Image.Image]:
    """Open a picture of a run, not decoded yet; whatever is wrong with it is a UserError."""
    check_file(path, "paint it again")
    with explaining(path, "paint it again"), Image.open(path, formats=WRITTEN) as picture:
        _check_size(*picture.size)
        yield picture


@contextmanager
def _silence() -> Iterator[None]:
    """Keep the remarks of decoders from the terminal: what matters of them ends as an error."""
    with _alone, open(os.devnull, "w") as nowhere, warnings.catch_warnings(action="ignore"):
        stderr, level = os.dup(2), logging.root.manager.disable
        logging.disable(logging.CRITICAL)
        os.dup2(nowhere.fileno(), 2)  # libtiff, a C library, writes there
        try:
            yield
        finally:
            os.dup2(stderr, 2)
            os.close(stderr)
            logging.disable(level)


@contextmanager
def _opened(path: Path) -> Iterator[ImageFile | None]:
    """Open a picture and read its first bytes; None for a TIFF that Pillow does not know."""
    with path.open("rb") as file:
        magic = file.read(4)
    if not magic:
        raise UserError("is empty (0 bytes); give a file that holds a picture")
    try:
        picture = Image.open(path)
    except UnidentifiedImageError:
        if magic not in TIFF_MAGIC:
            raise
        yield None
        return
    with picture:
        if picture.format not in FORMATS:
            raise UserError(f"is a file of the format {picture.format}, which is not read here; {CURE}")
        _check_size(*picture.size)
        yield picture


def _read(path: Path, backdrop: float) -> np.ndarray:
    with _opened(path) as picture:
        if picture is None or _needs_tifffile(picture):
            return _read_tiff(path, backdrop)
        return decode_image(picture, backdrop)


def decode_image(picture: Image.Image, backdrop: float = 1.0) -> np.ndarray:
    """Decode an image of Pillow as `read_picture` does; its decoder may raise anything."""
    if picture.mode == "F" or picture.mode.startswith("I"):
        samples, key = np.asarray(picture)[..., None], picture.info.get("transparency")
        alpha = None if key is None else (samples != key).astype(np.float32)
        bits = max(picture.tag_v2.get(BITS, (16,))) if isinstance(picture, TiffImageFile) else 16
        rgb = _float_to_srgb(_unit_range(samples, bits), alpha, picture.info.get("icc_profile"), backdrop)
    else:
        rgb = _bytes_to_srgb(picture, backdrop)
    # Pillow turns a TIFF itself as it loads, and nothing else.
    return rgb if isinstance(picture, TiffImageFile) else _upright(rgb, _orientation(picture))


def _check_size(width: int, height: int) -> None:
    if width * height > MAX_PIXELS:
        raise UserError(_too_large(f"{width} x {height} pixels"))


def _too_large(size: str) -> str:
    return f"has {size}; at most {MAX_PIXELS // 10**6} megapixels are read: make it smaller and give that file"


def _bytes_to_srgb(picture: Image.Image, backdrop: float) -> np.ndarray:
    picture.load()
    alpha = picture.convert("RGBA").getchannel("A") if picture.has_transparency_data else None
    profile = picture.info.get("icc_profile")
    if picture.mode not in ("L", "RGB", "CMYK"):
        picture = picture.convert("L" if picture.mode in ("1", "LA") else "RGB")
    rgb = _converted(picture, profile)
    if alpha is not None:
        rgb = Image.composite(rgb, Image.new("RGB", rgb.size, (round(255 * backdrop),) * 3), alpha)
    return np.asarray(rgb)


def _converted(picture: Image.Image, profile: bytes | None) -> Image.Image:
    """Convert a picture of mode L, RGB or CMYK to sRGB; its raw values if the profile does not work."""
    converted = None
    if profile:
        with suppress(ImageCms.PyCMSError, OSError, ImportError):  # the last: a Pillow that was built without it
            source, target = ImageCms.ImageCmsProfile(io.BytesIO(profile)), ImageCms.createProfile("sRGB")
            converted = ImageCms.profileToProfile(picture, source, target, outputMode="RGB")
    return picture.convert("RGB") if converted is None else converted


def _float_to_srgb(color: np.ndarray, alpha: np.ndarray | None, profile: bytes | None, backdrop: float) -> np.ndarray:
    """Convert colours (H, W, 1 or 3) and alpha (H, W, 1) in [0, 1] to (H, W, 3) float32."""
    if profile:
        # What the conversion does in 8 bits is added to the exact values, so that an sRGB profile changes nothing.
        eight_bit = np.rint(color * 255).astype(np.uint8)
        coarse = Image.fromarray(eight_bit[..., 0] if eight_bit.shape[2] == 1 else eight_bit)
        change = np.asarray(_converted(coarse, profile), np.float32) - eight_bit
        color = (color + change / 255).clip(0, 1)
    if alpha is not None:
        color = color * alpha + backdrop * (1 - alpha)
    return np.broadcast_to(color, (*color.shape[:2], 3))


def _needs_tifffile(picture: ImageFile) -> bool:
    """Decide whether a TIFF has more than 8 bits and Pillow misreads it or tifffile can unpack it."""
    if not isinstance(picture, TiffImageFile) or max(picture.tag_v2.get(BITS, (1,))) <= 8:
        return False
    tags = picture.tag_v2
    misread = tags.get(PLANES) == 2 or tags.get(PHOTOMETRIC) == WHITE_IS_ZERO or picture.mode == "I"
    return misread or tags.get(COMPRESSION, 1) in UNPACKED


def _read_tiff(path: Path, backdrop: float) -> np.ndarray:
    from tifffile import TiffFile, TiffPage  # noqa: PLC0415  (rarely needed)

    with TiffFile(path) as tiff:
        page = tiff.pages[0]
        assert isinstance(page, TiffPage)
        _check_size(page.imagewidth, page.imagelength)
        n_colors = {WHITE_IS_ZERO: 1, BLACK_IS_ZERO: 1, RGB: 3}.get(page.photometric, 0)
        if not n_colors or not n_colors <= page.samplesperpixel <= 4 or page.axes not in ("YX", "YXS", "SYX"):
            raise UserError(f"is a TIFF that is neither grey nor RGB; {CURE}")
        if math.prod(page.chunked) > len(page.dataoffsets):  # each would be made up, one by one
            raise UserError(f"is damaged or cannot be decoded (rows are missing); {CURE}")
        samples = np.atleast_3d(page.asarray())
        orientation, profile = (page.tags.valueof(code) for code in (ORIENTATION, PROFILE))
    if samples.dtype.kind not in "uf":
        raise UserError(f"is a TIFF of signed or complex numbers; {CURE}")
    unit = _unit_range(np.moveaxis(samples, 0, 2) if page.axes == "SYX" else samples, page.bitspersample)
    color = 1 - unit[..., :1] if page.photometric == WHITE_IS_ZERO else unit[..., :n_colors]
    extra = next(iter(page.extrasamples), None)
    alpha = unit[..., n_colors : n_colors + 1] if extra in (ASSOCIATED, UNASSOCIATED) else None
    if alpha is not None and extra == ASSOCIATED:
        color = np.divide(color, alpha, out=np.ones_like(color), where=alpha > 0).clip(0, 1)
    return _upright(_float_to_srgb(color, alpha, profile, backdrop), orientation or 1)


def _unit_range(samples: np.ndarray, bits: int) -> np.ndarray:
    """Convert samples to float32 in [0, 1]; floats are taken as they are, and refused outside that range."""
    unit = samples.astype(np.float32)
    if samples.dtype.kind != "f":
        unit /= 2**bits - 1
    if not np.isfinite(unit).all():
        raise UserError(f"has pixels that are NaN or infinite; {CURE}")
    if unit.min() < 0 or unit.max() > 1:
        raise UserError(f"has values from {samples.min():g} to {samples.max():g}; scale them to 0 to 1, or {CURE}")
    return unit


def _orientation(picture: Image.Image) -> int:
    """Read the EXIF orientation of a picture, 1 to 8; 1 if there is none that can be read."""
    try:
        return int(picture.getexif().get(ORIENTATION, 1))
    except Exception:  # damaged EXIF data raise nearly anything; they do not make the picture worse
        return 1


def _upright(pixels: np.ndarray, orientation: int) -> np.ndarray:
    if orientation >= SWAPPED:
        pixels = pixels.swapaxes(0, 1)
    if orientation in (2, 3, 6, 7):
        pixels = pixels[:, ::-1]
    if orientation in (3, 4, 7, 8):
        pixels = pixels[::-1]
    return pixels
