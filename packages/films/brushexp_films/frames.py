"""Convert decoded frames to upright sRGB over white, with square pixels."""

import math
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, NamedTuple

import numpy as np
from PIL import Image

from brushexp.contracts.pictures import HIGH_RANGE, Crop, encoding_of, unless_srgb

MATRIX = "DISPLAYMATRIX"  # FFmpeg's name for a container's rotation and mirroring
FULL = 2  # FFmpeg's code for full-range samples
RED, BLUE = 0.2627, 0.0593  # luma weights of BT.2020


class Placement(NamedTuple):
    """Orientation of a picture on screen: optionally mirrored horizontally, then rotated."""

    is_mirrored: bool = False
    turns: int = 0  # quarter turns, counter-clockwise


@dataclass(frozen=True)
class Shape:
    """Pixel aspect ratio and crop that all stored pictures of a film share."""

    aspect: Fraction = Fraction(1)  # pixel width / height
    crop: Crop | None = None  # visible rows and columns; None for all


def size_of(frame: Any, shape: Shape) -> tuple[int, int]:
    """Compute the height and width of the picture that `srgb_of` returns."""
    rows, columns = shape.crop or (slice(0, frame.height), slice(0, frame.width))
    size = (rows.stop - rows.start, max(1, round((columns.stop - columns.start) * shape.aspect)))
    return size[::-1] if placement_of(frame).turns % 2 else size


def srgb_of(frame: Any, shape: Shape) -> np.ndarray:
    """Convert an FFmpeg frame to sRGB (H, W, 3), uint8."""
    encoding = unless_srgb(encoding_of(int(frame.color_primaries), int(frame.color_trc)))
    if int(frame.color_trc) in HIGH_RANGE and encoding is not None:
        picture = np.rint(255 * encoding.to_srgb(_deep(frame))).astype(np.uint8)
    else:
        picture = over_white(frame)
        picture = picture if encoding is None else encoding.to_srgb(picture)
    picture = picture if shape.crop is None else picture[shape.crop]
    height, wide = picture.shape[:2]
    width = max(1, round(wide * shape.aspect))
    if width != wide:
        picture = np.asarray(Image.fromarray(picture).resize((width, height), Image.Resampling.LANCZOS))
    placement = placement_of(frame)
    picture = picture[:, ::-1] if placement.is_mirrored else picture
    return np.ascontiguousarray(np.rot90(picture, placement.turns))


def over_white(frame: Any) -> np.ndarray:
    """Convert a frame to RGB, compositing transparent pixels over white."""
    if not any(component.is_alpha for component in frame.format.components):
        picture: np.ndarray = frame.to_ndarray(format="rgb24")
        return picture
    samples = frame.to_ndarray(format="rgba").astype(np.float32)
    alpha = samples[..., 3:] / 255
    return np.rint(samples[..., :3] * alpha + 255 * (1 - alpha)).astype(np.uint8)


def _deep(frame: Any) -> np.ndarray:
    """Convert a frame of 10 or more bits to BT.2020 RGB (H, W, 3) in [0, 1]."""
    if frame.format.is_rgb:
        return frame.to_ndarray(format="rgb48le").astype(np.float32) / 65535
    planes = frame.reformat(format="yuv444p16le")
    rows = [np.frombuffer(plane, np.uint16).reshape(frame.height, -1)[:, : frame.width] for plane in planes.planes]
    y, cb, cr = (row.astype(np.float32) / 256 for row in rows)  # in 8-bit levels
    black, levels, of_colors = (0, 255, 255) if int(frame.color_range) == FULL else (16, 219, 224)
    y, cb, cr = (y - black) / levels, (cb - 128) / of_colors, (cr - 128) / of_colors
    red, blue = y + 2 * (1 - RED) * cr, y + 2 * (1 - BLUE) * cb
    green = (y - RED * red - BLUE * blue) / (1 - RED - BLUE)
    return np.stack([red, green, blue], 2).clip(0, 1)


def placement_of(frame: Any) -> Placement:
    """Read a decoded picture's orientation from its 3 x 3 display matrix (ISO/IEC 14496-12, 6.2.2)."""
    said = frame.side_data.get(MATRIX)
    if said is None:
        return Placement()
    a, b, _, c, d = np.frombuffer(said, np.int32)[:5].astype(float)
    if a * d < b * c:  # (x, y) is shown at (a x + c y, b x + d y)
        return Placement(is_mirrored=True, turns=_turns(-a, -b))
    return Placement(turns=_turns(a, b))


def _turns(x: float, y: float) -> int:
    """Count the counter-clockwise quarter turns that rotate a rightward row to the direction (x, y), with y down."""
    return round(-math.atan2(y, x) / (math.pi / 2)) % 4
