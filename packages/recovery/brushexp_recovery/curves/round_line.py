"""Round-ended lines with as much paint as a stroke."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from brushexp_recovery.curves.bezier import arc_lengths, part_of

Array = NDArray[Any]

ROUND_LOSS = 0.215  # widths by which a round-ended line is longer than a rectangle of the same area: 1 - pi / 4
CAP = 0.45  # widths by which a round end reaches beyond the end of the curve
LEAST_EXTENT = 0.05  # share of a curve that carries paint, at least


def width_of_line(area: Any, extent: Any) -> Any:
    """Find the width of a round-ended line from its area and its length from tip to tip, in pixels; arrays (N,) too."""
    width = np.minimum(area / extent, extent)
    return np.minimum(area / np.maximum(extent - ROUND_LOSS * width, 1), extent)


def trim_to_paint(curve: Array, low: Array, high: Array, area: Array) -> tuple[Array, Array]:
    """Cut curves (N, 3, 2) to the parts that carry paint, and find widths (N,) of round-ended lines with as much of it.

    ``low`` and ``high`` (N,) are the parameters between which paint lies, ``area`` (N,) is pixels of paint. The cut
    curves end where a round end of the width begins.
    """
    length = np.maximum(arc_lengths(curve), 1e-6)
    width = width_of_line(area, np.maximum(high - low, LEAST_EXTENT) * length)
    cap, middle = CAP * width / length, 0.5 * (low + high)
    is_long = high - low > 2 * cap + 0.02
    first = np.where(is_long, low + cap, middle - 0.01)
    last = np.where(is_long, high - cap, middle + 0.01)
    return part_of(curve, first, last), width
