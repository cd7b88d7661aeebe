"""Pixels that are not square are made square, as a picture says what shape they have; pictures are resampled."""

from contextlib import suppress
from typing import Any

import numpy as np
from PIL import Image

from brushexp.pictures.carriers import head_of
from brushexp.pictures.srgb import SWAPPED, orientation_of

X_RESOLUTION, Y_RESOLUTION = 282, 283  # tags of TIFF
GIF_ASPECT = 12  # byte of a GIF: 64 times the aspect, less 15; 0: square
PSD_ASPECT = 1064  # resource of Photoshop: a version, and the aspect as a double
SQUARE = 0.01  # a ratio within that of 1 is one of rounded numbers
MOST_ASPECT = 4  # a ratio beyond that is taken for a mistake


def pixel_aspect(picture: Image.Image) -> float:
    """Read width over height of the pixels of an upright picture, before it is decoded; 1 if its file says nothing."""
    aspect = 1.0
    with suppress(Exception):  # damaged numbers raise nearly anything; they do not make the picture worse
        across, down = _densities(picture)
        aspect = float(down) / float(across)
    if abs(aspect - 1) < SQUARE or not 1 / MOST_ASPECT <= aspect <= MOST_ASPECT:
        return 1.0
    return 1 / aspect if orientation_of(picture) >= SWAPPED else aspect


def _densities(picture: Any) -> tuple[Any, Any]:
    """Read how many pixels a length has, across and down, in any unit."""
    info, head = picture.info, head_of(picture)
    if picture.format in ("JPEG", "MPO"):
        return info.get("jfif_density", (1, 1))
    if picture.format == "TIFF":
        return picture.tag_v2.get(X_RESOLUTION, 1), picture.tag_v2.get(Y_RESOLUTION, 1)
    if picture.format == "GIF" and head[GIF_ASPECT]:
        return 64, head[GIF_ASPECT] + 15
    if picture.format in ("AVIF", "HEIF") and (said := head.partition(b"pasp")[2]):
        return int.from_bytes(said[4:8]), int.from_bytes(said[:4])
    if picture.format == "PSD":
        said = next((data for number, _, data in picture.resources if number == PSD_ASPECT), b"")
        return 1, np.frombuffer(said[4:12], ">f8")[0] if said else 1
    return info.get("aspect") or info.get("dpi", (1, 1))  # PNG, BMP, JPEG 2000


def squared(height: int, width: int, aspect: float) -> tuple[int, int]:
    """Compute the height and width of a picture with square pixels, of which neither side is smaller than before."""
    return (height, round(width * aspect)) if aspect > 1 else (round(height / aspect), width)


def resample(picture: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Resample a picture (H, W, 3) to a height and width by Lanczos, 3 lobes, widened when it shrinks.

    The dtype stays.
    """
    height, width = size
    if picture.shape[:2] == size:
        return picture
    if picture.dtype == np.uint8:
        return np.asarray(Image.fromarray(picture).resize((width, height), Image.Resampling.LANCZOS))
    channels = [Image.fromarray(picture[..., c]).resize((width, height), Image.Resampling.LANCZOS) for c in range(3)]
    return np.stack([np.asarray(channel) for channel in channels], 2).clip(0, 1)  # Lanczos overshoots at edges
