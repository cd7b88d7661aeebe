"""A decoded picture of a film becomes sRGB over white, upright, with square pixels, whatever the film says of it."""

from fractions import Fraction
from typing import Any

import numpy as np
from PIL import Image

from brushexp.contracts.pictures import HIGH_RANGE, encoding_of, unless_srgb

FULL = 2  # FFmpeg's number for numbers that use their whole range
RED, BLUE = 0.2627, 0.0593  # weights of BT.2020 in brightness


def size_of(frame: Any, aspect: Fraction) -> tuple[int, int]:
    """Compute height and width of a picture as `srgb_of` makes it; ``aspect`` is width / height of a pixel."""
    size = (frame.height, max(1, round(frame.width * aspect)))
    return size[::-1] if _turns(frame) % 2 else size


def srgb_of(frame: Any, aspect: Fraction) -> np.ndarray:
    """Convert a picture of FFmpeg to (H, W, 3) uint8."""
    encoding = unless_srgb(encoding_of(int(frame.color_primaries), int(frame.color_trc)))
    if int(frame.color_trc) in HIGH_RANGE and encoding is not None:
        picture = np.rint(255 * encoding.to_srgb(_deep(frame))).astype(np.uint8)
    else:
        picture = over_white(frame)
        picture = picture if encoding is None else encoding.to_srgb(picture)
    height, width = size_of(frame, aspect)[:: -1 if _turns(frame) % 2 else 1]
    if width != frame.width:
        picture = np.asarray(Image.fromarray(picture).resize((width, height), Image.Resampling.LANCZOS))
    return np.ascontiguousarray(np.rot90(picture, _turns(frame)))


def over_white(frame: Any) -> np.ndarray:
    """Convert a picture to RGB; where it is transparent, white is seen."""
    if not any(component.is_alpha for component in frame.format.components):
        picture: np.ndarray = frame.to_ndarray(format="rgb24")
        return picture
    samples = frame.to_ndarray(format="rgba").astype(np.float32)
    alpha = samples[..., 3:] / 255
    return np.rint(samples[..., :3] * alpha + 255 * (1 - alpha)).astype(np.uint8)


def _deep(frame: Any) -> np.ndarray:
    """Convert a picture of 10 or more bits to RGB (H, W, 3) in [0, 1], of BT.2020."""
    if frame.format.is_rgb:
        return frame.to_ndarray(format="rgb48le").astype(np.float32) / 65535
    planes = frame.reformat(format="yuv444p16le")
    rows = [np.frombuffer(plane, np.uint16).reshape(frame.height, -1)[:, : frame.width] for plane in planes.planes]
    y, cb, cr = (row.astype(np.float32) / 256 for row in rows)  # in levels of 8 bits
    black, levels, of_colors = (0, 255, 255) if int(frame.color_range) == FULL else (16, 219, 224)
    y, cb, cr = (y - black) / levels, (cb - 128) / of_colors, (cr - 128) / of_colors
    red, blue = y + 2 * (1 - RED) * cr, y + 2 * (1 - BLUE) * cb
    green = (y - RED * red - BLUE * blue) / (1 - RED - BLUE)
    return np.stack([red, green, blue], 2).clip(0, 1)


def _turns(frame: Any) -> int:
    return round(frame.rotation / 90) % 4
