"""Read the declared shape of a picture: its visible pixels and their aspect ratio."""

import os
import struct
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import numpy as np
from PIL import Image

from brushexp.pictures.boxes import Crop, clean_aperture_in
from brushexp.pictures.carriers import IN_BOXES, head_of, place_kept, properties_in_boxes
from brushexp.pictures.srgb import SWAPPED, orientation_of

X_RESOLUTION, Y_RESOLUTION = 282, 283  # TIFF tags
GIF_ASPECT = 12  # byte of a GIF: 64 times the aspect minus 15; 0 for square
TGA_FOOTER, TGA_NAME = struct.Struct("<II18s"), b"TRUEVISION-XFILE.\0"  # offsets of the extension and of another part
TGA_ASPECT = 474  # offset in the extension of the width and the height of a pixel
PSD_ASPECT = 1064  # Photoshop resource: a version, and the aspect as a double
SQUARE = 0.01  # ratios this close to 1 result from rounding
MOST_ASPECT = 4  # larger ratios are considered mistakes


def pixel_aspect(picture: Image.Image) -> float:
    """Read the pixel aspect ratio (width over height) of the upright picture before decoding; 1 if none is declared."""
    aspect = 1.0
    with suppress(Exception):  # damaged numbers may raise nearly any error, but the picture is intact
        across, down = _densities(picture)
        aspect = float(down) / float(across)
    if abs(aspect - 1) < SQUARE or not 1 / MOST_ASPECT <= aspect <= MOST_ASPECT:
        return 1.0
    return 1 / aspect if orientation_of(picture) >= SWAPPED or _is_turned_already(picture) else aspect


def _is_turned_already(picture: Any) -> bool:
    """Check whether the decoder itself swaps rows and columns, as the HEIF decoder does for an ``irot`` box."""
    turns = [data for name, data in properties_in_boxes(picture) if name == b"irot"] if picture.format == "HEIF" else []
    return sum(data[0] for data in turns if data) % 2 == 1


def clean_aperture(picture: Any) -> Crop | None:
    """Find the visible rows and columns of an AVIF before rotation; other decoders crop the picture themselves."""
    return clean_aperture_in(properties_in_boxes(picture), *picture.size) if picture.format == "AVIF" else None


def _densities(picture: Any) -> tuple[Any, Any]:
    """Read the horizontal and vertical pixel densities, in any unit."""
    read = DENSITIES.get(picture.format, _of_info)
    return read(picture)


def _of_info(picture: Any) -> tuple[Any, Any]:
    """Read the pixel densities that Pillow finds in PNG, BMP and JPEG 2000 files."""
    return picture.info.get("aspect") or picture.info.get("dpi", (1, 1))


def _of_jfif(picture: Any) -> tuple[Any, Any]:
    return picture.info.get("jfif_density", (1, 1))


def _of_tiff(picture: Any) -> tuple[Any, Any]:
    return picture.tag_v2.get(X_RESOLUTION, 1), picture.tag_v2.get(Y_RESOLUTION, 1)


def _of_gif(picture: Any) -> tuple[Any, Any]:
    said = head_of(picture)[GIF_ASPECT]
    return (64, said + 15) if said else (1, 1)


def _of_boxes(picture: Any) -> tuple[Any, Any]:
    said = next((data for name, data in properties_in_boxes(picture) if name == b"pasp"), b"")
    wide, high = struct.unpack(">II", said[:8]) if said else (1, 1)
    return high, wide


def _of_psd(picture: Any) -> tuple[Any, Any]:
    said = next((data for number, _, data in picture.resources if number == PSD_ASPECT), b"")
    return 1, np.frombuffer(said[4:12], ">f8")[0] if said else 1


def _of_tga(picture: Any) -> tuple[Any, Any]:
    """Read the aspect ratio from a TGA's extension area, whose offset is in the last bytes (Truevision, 1991)."""
    with place_kept(picture.fp):
        picture.fp.seek(-TGA_FOOTER.size, os.SEEK_END)
        extension, _, name = TGA_FOOTER.unpack(picture.fp.read())
        if name != TGA_NAME or not extension:
            return 1, 1
        picture.fp.seek(extension + TGA_ASPECT)
        wide, high = struct.unpack("<HH", picture.fp.read(4))
        return high, wide


DENSITIES: dict[str, Callable[[Any], tuple[Any, Any]]] = {  # readers by format
    "JPEG": _of_jfif,
    "MPO": _of_jfif,
    "TIFF": _of_tiff,
    "GIF": _of_gif,
    "PSD": _of_psd,
    "TGA": _of_tga,
    **dict.fromkeys(IN_BOXES, _of_boxes),
}


def size_in_square_pixels(height: int, width: int, aspect: float) -> tuple[int, int]:
    """Compute the height and width of a picture after conversion to square pixels; neither side shrinks."""
    return (height, round(width * aspect)) if aspect > 1 else (round(height / aspect), width)


def resample(picture: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Resample a picture (H, W, 3) to a ``size`` (H, W) with a 3-lobe Lanczos filter, widened for downsampling.

    The dtype is preserved.
    """
    height, width = size
    if picture.shape[:2] == size:
        return picture
    if picture.dtype == np.uint8:
        return np.asarray(Image.fromarray(picture).resize((width, height), Image.Resampling.LANCZOS))
    channels = [Image.fromarray(picture[..., c]).resize((width, height), Image.Resampling.LANCZOS) for c in range(3)]
    return np.stack([np.asarray(channel) for channel in channels], 2).clip(0, 1)  # Lanczos overshoots at edges
