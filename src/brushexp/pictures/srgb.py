"""Convert samples of any bit depth and colour encoding to sRGB, composited over a backdrop and turned upright."""

import io
from contextlib import suppress

import numpy as np
from PIL import Image, ImageCms

from brushexp.errors import UserError
from brushexp.pictures.carriers import Colors, exif_of
from brushexp.pictures.colorimetry import Encoding
from brushexp.pictures.kinds import CURE

ORIENTATION = 274  # TIFF and EXIF tag
UPRIGHT, ORIENTATIONS = 1, range(1, 9)
SWAPPED = 5  # first EXIF orientation that swaps rows and columns; the last is 8


def bytes_to_srgb(picture: Image.Image, colors: Colors, backdrop: float) -> np.ndarray:
    """Convert a Pillow image to sRGB (H, W, 3), uint8, composited over a backdrop."""
    picture.load()
    picture = picture.convert("LA") if picture.mode == "La" else picture  # the only conversion that Pillow offers
    alpha = picture.convert("RGBA").getchannel("A") if picture.has_transparency_data else None
    if picture.mode not in ("L", "RGB", "CMYK"):
        picture = picture.convert("L" if picture.mode in ("1", "LA") else "RGB")
    rgb = _convert(picture, colors)
    if alpha is not None:
        rgb = Image.composite(rgb, Image.new("RGB", rgb.size, (round(255 * backdrop),) * 3), alpha)
    return np.asarray(rgb)


def _convert(picture: Image.Image, colors: Colors) -> Image.Image:
    """Convert a Pillow image of mode L, RGB or CMYK to sRGB; keep its values if its profile is unusable."""
    if isinstance(colors, Encoding):
        return Image.fromarray(colors.to_srgb(np.asarray(picture.convert("RGB"))))
    converted = None
    if colors:
        with suppress(ImageCms.PyCMSError, OSError, ImportError):  # ImportError: Pillow was built without ImageCms
            source, target = ImageCms.ImageCmsProfile(io.BytesIO(colors)), ImageCms.createProfile("sRGB")
            converted = ImageCms.profileToProfile(picture, source, target, outputMode="RGB")
    return picture.convert("RGB") if converted is None else converted


def floats_to_srgb(color: np.ndarray, alpha: np.ndarray | None, colors: Colors, backdrop: float) -> np.ndarray:
    """Convert colours (H, W, 1 or 3) and alpha (H, W, 1) in [0, 1] to sRGB (H, W, 3), float32, over a backdrop."""
    if isinstance(colors, Encoding):
        color = colors.to_srgb(np.broadcast_to(color, (*color.shape[:2], 3)))
    elif colors:
        # The change due to an 8-bit conversion is added to the exact values, so an sRGB profile changes nothing.
        eight_bit = np.rint(color * 255).astype(np.uint8)
        coarse = Image.fromarray(eight_bit[..., 0] if eight_bit.shape[2] == 1 else eight_bit)
        change = np.asarray(_convert(coarse, colors), np.float32) - eight_bit
        color = (color + change / 255).clip(0, 1)
    if alpha is not None:
        color = color * alpha + backdrop * (1 - alpha)
    return np.broadcast_to(color, (*color.shape[:2], 3))


def unit_range(samples: np.ndarray, bits: int) -> np.ndarray:
    """Convert samples to float32 in [0, 1]; floats keep their values and raise a UserError outside this range."""
    unit = samples.astype(np.float32)
    if samples.dtype.kind != "f":
        unit /= 2**bits - 1
    if not np.isfinite(unit).all():
        raise UserError(f"has pixels that are NaN or infinite; {CURE}")
    if unit.min() < 0 or unit.max() > 1:
        raise UserError(f"has values from {samples.min():g} to {samples.max():g}; scale them to 0 to 1, or {CURE}")
    return unit


def orientation_of(picture: Image.Image) -> int:
    """Read a picture's EXIF orientation, 1 to 8; return 1 if it cannot be read."""
    exif = exif_of(picture)
    try:
        return valid_orientation(exif.get(ORIENTATION))
    except Exception:  # damaged EXIF data may raise nearly any error, but the picture is intact
        return UPRIGHT


def valid_orientation(number: object) -> int:
    """Return a valid EXIF orientation, 1 to 8, unchanged, and 1 for any other value."""
    return number if isinstance(number, int) and number in ORIENTATIONS else UPRIGHT


def upright(pixels: np.ndarray, orientation: int) -> np.ndarray:
    """Rotate and mirror a picture (H, W, C) according to its EXIF orientation, 1 to 8."""
    if orientation >= SWAPPED:
        pixels = pixels.swapaxes(0, 1)
    if orientation in (2, 3, 6, 7):
        pixels = pixels[:, ::-1]
    if orientation in (3, 4, 7, 8):
        pixels = pixels[::-1]
    return pixels
