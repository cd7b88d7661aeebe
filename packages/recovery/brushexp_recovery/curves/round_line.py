"""Find round-ended lines that cover the same area as a stroke's paint."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from brushexp_recovery.curves.bezier import arc_lengths, part_of

Array = NDArray[Any]

ROUND_LOSS = 0.215  # excess length of a round-ended line over a rectangle of the same area, in widths: 1 - pi / 4
CAP = 0.45  # distance in widths that a round end reaches beyond the end of the curve
LEAST_EXTENT = 0.05  # minimum share of a curve that carries paint


def width_of_line(area: Any, extent: Any) -> Any:
    """Find the width of round-ended lines, scalar or (N,), from their area and tip-to-tip length in pixels."""
    width = np.minimum(area / extent, extent)
    return np.minimum(area / np.maximum(extent - ROUND_LOSS * width, 1), extent)


def trim_to_paint(curve: Array, low: Array, high: Array, area: Array) -> tuple[Array, Array]:
    """Cut curves (N, 3, 2) to the segments that carry paint, and find widths (N,) that preserve the area of paint.

    Paint is present between the parameters ``low`` and ``high`` (N,); ``area`` (N,) is its area in pixels. The cut
    curves end where the round ends of the lines begin.
    """
    length = np.maximum(arc_lengths(curve), 1e-6)
    width = width_of_line(area, np.maximum(high - low, LEAST_EXTENT) * length)
    cap, middle = CAP * width / length, 0.5 * (low + high)
    is_long = high - low > 2 * cap + 0.02
    first = np.where(is_long, low + cap, middle - 0.01)
    last = np.where(is_long, high - cap, middle + 0.01)
    return part_of(curve, first, last), width
