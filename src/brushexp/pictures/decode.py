"""Picture files of many kinds -> display-referred sRGB; what each format does differently is settled here."""

from __future__ import annotations

import io
import logging
import os
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from PIL import Image, ImageCms, UnidentifiedImageError
from PIL.ImageFile import ImageFile, _Tile
from PIL.TiffImagePlugin import TiffImageFile

from brushexp.errors import UserError

MAX_PIXELS = 100_000_000  # in float32 RGB that many take 1.2 GB
# Raster formats only: for EPS, Pillow would start another program.
FORMATS = ("AVIF", "BMP", "DIB", "GIF", "JPEG", "JPEG2000", "MPO", "PNG", "PPM", "PSD", "QOI", "TGA", "TIFF", "WEBP")
TIFF_MAGIC = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")
BITS, PHOTOMETRIC, ORIENTATION, PLANES, PROFILE = 258, 262, 274, 284, 34675  # TIFF tags
WHITE_IS_ZERO, BLACK_IS_ZERO, RGB = 0, 1, 2  # values of PHOTOMETRIC
ASSOCIATED, UNASSOCIATED = 1, 2  # what an extra TIFF channel is: alpha that colours are, or are not, multiplied with
CURE = "convert it to an 8- or 16-bit PNG or a JPEG"


def read_picture(path: Path, *, key: str = "image", backdrop: float = 1.0) -> np.ndarray:
    """Decode the first frame of a picture, upright, over white, in sRGB.

    An embedded ICC profile is converted, unless it is broken; for pictures of more than 8 bits the conversion is
    accurate to 8 bits. 16-bit PNG with grey and alpha, and 16-bit CMYK, keep 8 bits.

    Args:
        path: the file.
        key: what the user types before the path, for messages.
        backdrop: what is below transparent pixels: 1 white, 0 black.

    Returns:
        (H, W, 3) uint8, or float32 in [0, 1] where the file holds more than 8 bits per channel.

    Raises:
        UserError: if the file cannot be read, is damaged or too large, is of a format or kind that has no plain
            meaning as a picture, or holds floats that are not in [0, 1].
    """
    with _silence():
        try:
            return np.ascontiguousarray(_read(path, backdrop))
        except UserError as error:
            raise UserError(str(error).replace("image=", f"{key}=", 1)) from error
        except Image.DecompressionBombError as error:
            size = f"more than {2 * (Image.MAX_IMAGE_PIXELS or 0) // 10**6} megapixels"
            raise _too_large(path, size, key) from error
        except UnidentifiedImageError as error:
            raise UserError(f"{key}={path} is not a picture of a known format; {CURE}") from error
        except Exception as error:  # decoders have a dozen kinds
            if isinstance(error, OSError) and error.strerror:
                raise UserError(
                    f"{key}={path} cannot be read ({error.strerror.lower()}); give a file that you may read"
                ) from error
            reason = " ".join(str(error).split()) or type(error).__name__
            raise UserError(f"{key}={path} is damaged or cannot be decoded ({reason}); {CURE}") from error


@contextmanager
def _silence() -> Iterator[None]:
    """Keep the remarks of decoders from the terminal: what matters of them ends as an error."""
    loggers = [logging.getLogger(name) for name in ("PIL", "tifffile")]
    levels = [logger.level for logger in loggers]
    with open(os.devnull, "w") as nowhere, warnings.catch_warnings():
        stderr = os.dup(2)
        try:
            warnings.simplefilter("ignore")
            for logger in loggers:
                logger.setLevel(logging.CRITICAL + 1)
            os.dup2(nowhere.fileno(), 2)  # libtiff, a C library, writes there
            yield
        finally:
            os.dup2(stderr, 2)
            os.close(stderr)
            for logger, level in zip(loggers, levels, strict=True):
                logger.setLevel(level)


def _read(path: Path, backdrop: float) -> np.ndarray:
    with path.open("rb") as file:
        magic = file.read(4)
    if not magic:
        raise UserError(f"image={path} is empty (0 bytes); give a file that holds a picture")
    try:
        picture = Image.open(path)
    except UnidentifiedImageError:
        if magic in TIFF_MAGIC:
            return _read_tiff(path, backdrop)
        raise
    with picture:
        if picture.format not in FORMATS:
            raise UserError(f"image={path} is a file of the format {picture.format}, which is not read here; {CURE}")
        _check_size(path, *picture.size)
        if _is_beyond_pillow(picture):
            return _read_tiff(path, backdrop)
        if picture.mode in ("I", "F") or picture.mode.startswith("I;16") or _low_byte_tiles(picture):
            color, alpha = _deep_channels(picture, path)
            rgb = _float_to_srgb(color, alpha, picture.info.get("icc_profile"), backdrop)
        else:
            rgb = _bytes_to_srgb(picture, backdrop)
        # Pillow turns a TIFF itself as it loads, and nothing else.
        return rgb if isinstance(picture, TiffImageFile) else _upright(rgb, _orientation(picture))


def _check_size(path: Path, width: int, height: int) -> None:
    if width * height > MAX_PIXELS:
        raise _too_large(path, f"{width} x {height} pixels")


def _too_large(path: Path, size: str, key: str = "image") -> UserError:
    limit = f"{MAX_PIXELS // 10**6} megapixels"
    return UserError(f"{key}={path} has {size}; at most {limit} are read: make it smaller and give that file")


def _bytes_to_srgb(picture: Image.Image, backdrop: float) -> np.ndarray:
    """(H, W, 3) uint8 of an 8-bit picture of any mode."""
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
    """A picture of mode L, RGB or CMYK as sRGB; its raw values if the profile does not work."""
    if profile:
        try:
            source = ImageCms.ImageCmsProfile(io.BytesIO(profile))
            target = ImageCms.createProfile("sRGB")
            converted = ImageCms.profileToProfile(picture, source, target, outputMode="RGB")
        except (ImageCms.PyCMSError, OSError, ImportError):  # the last: a Pillow that was built without it
            converted = None
        if converted is not None:
            return converted
    return picture.convert("RGB")


def _float_to_srgb(color: np.ndarray, alpha: np.ndarray | None, profile: bytes | None, backdrop: float) -> np.ndarray:
    """(H, W, 3) float32 from (H, W, 1 or 3) colours and (H, W, 1) alpha, all in [0, 1]."""
    if profile:
        # What the conversion does in 8 bits is added to the exact values, so that an sRGB profile changes nothing.
        eight_bit = np.rint(color * 255).astype(np.uint8)
        coarse = Image.fromarray(eight_bit[..., 0] if eight_bit.shape[2] == 1 else eight_bit)
        change = np.asarray(_converted(coarse, profile), np.float32) - eight_bit
        color = (color + change / 255).clip(0, 1)
    if alpha is not None:
        color = color * alpha + backdrop * (1 - alpha)
    return np.broadcast_to(color, (*color.shape[:2], 3))


def _deep_channels(picture: ImageFile, path: Path) -> tuple[np.ndarray, np.ndarray | None]:
    """Colours (H, W, 1 or 3) and alpha (H, W, 1) in [0, 1] of a picture with more than 8 bits per channel."""
    tiles = _low_byte_tiles(picture)
    samples = np.atleast_3d(np.asarray(picture))
    if tiles:
        with Image.open(path) as again:
            again.tile = tiles
            samples = samples.astype(np.uint16) << 8 | np.asarray(again)
    key = picture.info.get("transparency")
    alpha = None if key is None else (samples != np.asarray(key)).any(2, keepdims=True).astype(np.float32)
    bits = max(picture.tag_v2.get(BITS, (16,))) if isinstance(picture, TiffImageFile) else 16
    unit = _unit_range(samples, bits, path)
    return (unit[..., :3], unit[..., 3:]) if unit.shape[2] == 4 else (unit, alpha)


def _low_byte_tiles(picture: ImageFile) -> list[_Tile]:
    """Instructions that decode the low bytes of a 16-bit RGB picture; empty for any other.

    Pillow has no mode for such a picture and keeps the high bytes. Told that the bytes are swapped, it keeps the low.
    """
    swapped = {"B": "L", "L": "B", "N": "B" if sys.byteorder == "little" else "L"}
    tiles = []
    for tile in picture.tile:
        layout, *rest = (tile.args,) if isinstance(tile.args, str) else tile.args or ("",)
        if str(layout)[:-1] not in ("RGB;16", "RGBX;16", "RGBA;16"):
            return []
        layout = layout[:-1] + swapped[layout[-1]]
        tiles.append(tile._replace(args=(layout, *rest)))
    return tiles


def _is_beyond_pillow(picture: ImageFile) -> bool:
    """Whether a TIFF is of a kind that Pillow opens but reads wrongly: deep, in planes, inverted or of 32 bits."""
    if not isinstance(picture, TiffImageFile) or max(picture.tag_v2.get(BITS, (1,))) <= 8:
        return False
    tags = picture.tag_v2
    return tags.get(PLANES) == 2 or tags.get(PHOTOMETRIC) == WHITE_IS_ZERO or picture.mode == "I"


def _read_tiff(path: Path, backdrop: float) -> np.ndarray:
    """(H, W, 3) float32 of the first page of a TIFF that Pillow cannot read."""
    from tifffile import TiffFile, TiffPage  # noqa: PLC0415  (rarely needed)

    with TiffFile(path) as tiff:
        page = tiff.pages[0]
        assert isinstance(page, TiffPage)
        _check_size(path, page.imagewidth, page.imagelength)
        n_colors = {WHITE_IS_ZERO: 1, BLACK_IS_ZERO: 1, RGB: 3}.get(page.photometric, 0)
        if not n_colors or not n_colors <= page.samplesperpixel <= 4 or page.axes not in ("YX", "YXS", "SYX"):
            raise UserError(f"image={path} is a TIFF that is neither grey nor RGB; {CURE}")
        samples = np.atleast_3d(page.asarray())
        tags = {code: page.tags.valueof(code) for code in (ORIENTATION, PROFILE)}
    if samples.dtype.kind not in "uf":
        raise UserError(f"image={path} is a TIFF of signed or complex numbers; {CURE}")
    unit = _unit_range(np.moveaxis(samples, 0, 2) if page.axes == "SYX" else samples, page.bitspersample, path)
    color = 1 - unit[..., :1] if page.photometric == WHITE_IS_ZERO else unit[..., :n_colors]
    extra = next(iter(page.extrasamples), None)
    alpha = unit[..., n_colors : n_colors + 1] if extra in (ASSOCIATED, UNASSOCIATED) else None
    if alpha is not None and extra == ASSOCIATED:
        color = np.divide(color, alpha, out=np.ones_like(color), where=alpha > 0).clip(0, 1)
    return _upright(_float_to_srgb(color, alpha, tags[PROFILE], backdrop), tags[ORIENTATION] or 1)


def _unit_range(samples: np.ndarray, bits: int, path: Path) -> np.ndarray:
    """Samples as float32 in [0, 1]; floats are taken as they are.

    Raises:
        UserError: if they are not in that range.
    """
    unit = samples.astype(np.float32)
    if samples.dtype.kind != "f":
        unit /= 2**bits - 1
    if not np.isfinite(unit).all():
        raise UserError(f"image={path} has pixels that are NaN or infinite; {CURE}")
    if unit.min() < 0 or unit.max() > 1:
        raise UserError(
            f"image={path} has values from {samples.min():g} to {samples.max():g}; scale them to 0 to 1, or {CURE}"
        )
    return unit


def _orientation(picture: Image.Image) -> int:
    """The EXIF orientation of a picture, 1 to 8; 1 if there is none that can be read."""
    try:
        return int(picture.getexif().get(ORIENTATION, 1))
    except Exception:  # damaged EXIF data raise nearly anything; they do not make the picture worse
        return 1


def _upright(pixels: np.ndarray, orientation: int) -> np.ndarray:
    """Turn and mirror (H, W, 3) as the EXIF orientation says."""
    if orientation in (5, 6, 7, 8):
        pixels = pixels.swapaxes(0, 1)
    if orientation in (2, 3, 6, 7):
        pixels = pixels[:, ::-1]
    if orientation in (3, 4, 7, 8):
        pixels = pixels[::-1]
    return pixels
