"""What lies around each stroke: how many others, and how much they are like it."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Doubled = NDArray[np.complex128]  # directions as e^{2 i angle}, the same for both ways along a stroke
Index = NDArray[np.intp]
PAIRS = 2**22  # that are held at once: some 300 MB


def surroundings_of(places: Array, angle: Array, width: Array, radius: float, alike: float) -> dict[str, Array]:
    """The measures (N,) that depend on neighbours, as `measures.Measures` defines them.

    Args:
        places: (N, 2) centres, pixels.
        angle: (N,) directions, radians; NaN where there is none.
        width: (N,) thicknesses.
        radius: pixels: a neighbour's centre is as near or nearer.
        alike: radians: an aligned neighbour's direction differs by as much or less.
    """
    heading = doubled(angle)
    total = np.zeros(len(places), np.complex128)
    number, near, breadth, square, aligned = (np.zeros(len(places)) for _ in range(5))
    for rows, i, j in _pairs(places, places, radius):
        n = rows.stop - rows.start
        total[rows], number[rows] = _sums(heading, i, j, n)
        near[rows], breadth[rows] = np.bincount(i, None, n), np.bincount(i, width[j], n)
        square[rows] = np.bincount(i, width[j] ** 2, n)
        like = (heading[rows][i] * heading[j].conj()).real >= np.cos(2 * alike)
        aligned[rows] = np.bincount(i, like & (i + rows.start != j), n)
    alone = near < 2
    coherence = np.where(alone, np.nan, np.abs(_mean(total, number)))
    with np.errstate(invalid="ignore"):
        mean = breadth / near
        spread = np.sqrt(np.maximum(square / near - mean**2, 0))
        homogeneity = np.where(alone, np.nan, mean / (mean + spread))
    return {
        "neighbours": near - 1,
        "aligned": aligned,
        "deviation": np.sqrt(0.5 * (1 - coherence)),
        "coherence": coherence,
        "homogeneity": homogeneity,
    }


def mean_direction(points: Array, places: Array, angle: Array, radius: float) -> tuple[Doubled, Array]:
    """Mean of e^{2 i angle} (Q,) over the strokes whose centres are within ``radius`` of points (Q, 2).

    Its absolute value is their coherence, at most 1, and half of its argument their mean direction.

    Args:
        points: (Q, 2) pixels.
        places: (N, 2) centres of strokes.
        angle: (N,) their directions, radians; NaN for one that has none and is passed over.
        radius: pixels.

    Returns:
        The mean (Q,), NaN where there is no stroke, and of how many strokes (Q,) it is.
    """
    heading = doubled(angle)
    total, number = np.zeros(len(points), np.complex128), np.zeros(len(points))
    for rows, i, j in _pairs(points, places, radius):
        total[rows], number[rows] = _sums(heading, i, j, rows.stop - rows.start)
    return _mean(total, number), number


def doubled(angle: Array) -> Doubled:
    """Directions as e^{2 i angle}; 0 for NaN."""
    known = np.isfinite(angle)
    return np.where(known, np.exp(2j * np.where(known, angle, 0.0)), 0)


def _sums(heading: Doubled, i: Index, j: Index, n: int) -> tuple[Doubled, Array]:
    """Sum of the directions of strokes j by n points i, and how many have one."""
    found = heading[j]
    total: Doubled = np.bincount(i, found.real, n) + 1j * np.bincount(i, found.imag, n)
    return total, np.bincount(i, found != 0, n).astype(np.float64)


def _mean(total: Doubled, number: Array) -> Doubled:
    """Mean direction, not longer than 1; NaN of none."""
    with np.errstate(invalid="ignore", divide="ignore"):
        mean: Doubled = np.where(number > 0, total / number, np.nan)
        limited: Doubled = mean / np.maximum(np.abs(mean), 1)
    return limited


def _pairs(points: Array, places: Array, radius: float) -> Iterator[tuple[slice, Index, Index]]:
    """Which places are near which points, a block of points at a time.

    Yields:
        The block, and pairs of a point, counted from the block's first, and a place.
    """
    from scipy.spatial import cKDTree  # noqa: PLC0415  (slow to import)

    if not len(points) or not len(places):
        return
    tree = cKDTree(places)
    until = np.cumsum(tree.query_ball_point(points, radius, return_length=True))
    first = 0
    while first < len(points):
        before = until[first - 1] if first else 0
        last = max(first + 1, int(np.searchsorted(until, before + PAIRS, side="right")))
        found = cKDTree(points[first:last]).sparse_distance_matrix(tree, radius, output_type="ndarray")
        yield slice(first, last), found["i"], found["j"]
        first = last
