"""Compute points, arc lengths, segments and chords of quadratic Bezier curves."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]

LENGTH_POINTS = 65  # number of points between which an arc is measured


def points_on(curve: Array, count: int) -> Array:
    """Return ``count`` points (N, count, 2) on curves (N, 3, 2), at evenly spaced parameters."""
    t = np.linspace(0, 1, count)[:, None]
    start, control, end = (curve[:, k, None] for k in range(3))
    return (1 - t) ** 2 * start + 2 * t * (1 - t) * control + t**2 * end


def arc_lengths(curve: Array) -> Array:
    """Measure the arc lengths (N,) of curves (N, 3, 2)."""
    return np.linalg.norm(np.diff(points_on(curve, LENGTH_POINTS), axis=1), axis=-1).sum(1)


def part_of(curve: Array, low: Array, high: Array) -> Array:
    """Cut curves (N, 3, 2) at parameters ``low`` and ``high`` (N,), or extend them if these are outside [0, 1]."""
    start, control, end = (curve[:, k] for k in range(3))

    def blossom(a: Array, b: Array) -> Array:
        a, b = a[:, None], b[:, None]
        return (1 - a) * (1 - b) * start + (a * (1 - b) + b * (1 - a)) * control + a * b * end

    return np.stack([blossom(low, low), blossom(low, high), blossom(high, high)], 1)


def chords_of(curve: Array) -> Array:
    """Return the vectors (N, 2) from the starts to the ends of curves (N, 3, 2)."""
    start, _, end = (curve[:, k] for k in range(3))
    return end - start
