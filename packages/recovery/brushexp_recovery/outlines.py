"""Strokes as round-ended lines along quadratic Bezier curves: what they cover, and which of them is seen where."""
# mypy: allow-untyped-defs

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from brushexp.compat.compiled import function

Array: TypeAlias = NDArray[Any]
Cover: TypeAlias = tuple[tuple[slice, slice], Array]  # rows and columns of a box, and the covered shares in it

PIECES = 24  # straight pieces of a curve
SAMPLES = 65  # points at which an arc is measured


def points_of(curve: Array, count: int = PIECES + 1) -> Array:
    """Return ``count`` points (N, count, 2) of curves (N, 3, 2), at even steps of the parameter."""
    t = np.linspace(0, 1, count)[:, None]
    start, control, end = (curve[:, k, None] for k in range(3))
    return (1 - t) ** 2 * start + 2 * t * (1 - t) * control + t**2 * end


def lengths_of(curve: Array) -> Array:
    """Measure the arc lengths (N,) of curves (N, 3, 2)."""
    return np.linalg.norm(np.diff(points_of(curve, SAMPLES), axis=1), axis=-1).sum(1)


def part_of(curve: Array, low: Array, high: Array) -> Array:
    """Cut curves (N, 3, 2) to their parts between parameters ``low`` and ``high`` (N,), which may be beyond 0 to 1."""
    start, control, end = (curve[:, k] for k in range(3))

    def blossom(a: Array, b: Array) -> Array:
        a, b = a[:, None], b[:, None]
        return (1 - a) * (1 - b) * start + (a * (1 - b) + b * (1 - a)) * control + a * b * end

    return np.stack([blossom(low, low), blossom(low, high), blossom(high, high)], 1)


def covers_of(curve: Array, width: Array, size: tuple[int, int]) -> list[Cover | None]:
    """Draw the N strokes alone on a canvas (H, W): the shares of pixels that each covers, None off the canvas."""
    covers: list[Cover | None] = []
    for points, half in zip(points_of(curve), 0.5 * width, strict=True):
        low = np.maximum(np.floor(points.min(0) - half - 1).astype(int), 0)
        high = np.minimum(np.ceil(points.max(0) + half + 1).astype(int), size[::-1])
        if (low >= high).any():
            covers.append(None)
            continue
        squared = np.full((high - low)[::-1], np.inf)
        _lower_to_distance(points, low, squared)
        away = np.sqrt(squared)
        share = np.clip(half + 0.5 - away, 0, 1) - np.clip(-half + 0.5 - away, 0, 1)
        covers.append(((slice(low[1], high[1]), slice(low[0], high[0])), share))
    return covers


@function
def _lower_to_distance(points, corner, squared):
    """Lower ``squared`` (h, w) to the squared distance of pixel centres from a line through ``points``."""
    for k in range(len(points) - 1):
        ax, ay = points[k, 0], points[k, 1]
        dx, dy = points[k + 1, 0] - ax, points[k + 1, 1] - ay
        norm = max(dx * dx + dy * dy, 1e-9)
        for i in range(squared.shape[0]):
            for j in range(squared.shape[1]):
                x, y = corner[0] + j + 0.5 - ax, corner[1] + i + 0.5 - ay
                t = min(max((x * dx + y * dy) / norm, 0.0), 1.0)
                x, y = x - t * dx, y - t * dy
                squared[i, j] = min(squared[i, j], x * x + y * y)


def seen_of(covers: list[Cover | None], opacity: Array, size: tuple[int, int]) -> tuple[Array, Array]:
    """Find which stroke is seen at each pixel, and how much each covers.

    The strokes come bottom to top. Seen is the one that adds most to a pixel, or the ground where that adds more.

    Returns:
        labels (H, W) int32, -1 the ground; area (N,) in pixels, hidden parts too.
    """
    light, best, labels = np.ones(size), np.zeros(size), np.full(size, -1, np.int32)
    area = np.zeros(len(covers))
    for number in range(len(covers) - 1, -1, -1):
        if (cover := covers[number]) is None:
            continue
        box, share = cover
        area[number] = (share >= 0.5).sum()
        adds = opacity[number] * share * light[box]
        more = adds > best[box]
        best[box] = np.where(more, adds, best[box])
        labels[box] = np.where(more, number, labels[box])
        light[box] *= 1 - opacity[number] * share
    labels[light > best] = -1
    return labels, area


def overlapping(covers: list[Cover | None], least: int, part: float) -> Array:
    """List pairs (P, 2), lower and upper, of strokes that share ``least`` pixels and that ``part`` of the smaller."""
    empty = (slice(0, 0), slice(0, 0)), np.empty((0, 0))
    placed = [cover or empty for cover in covers]
    masks = [share >= 0.5 for _, share in placed]
    edges = np.array([(rows.start, rows.stop, columns.start, columns.stop) for (rows, columns), _ in placed])
    area = [int(mask.sum()) for mask in masks]
    pairs = []
    for j, (top, bottom, left, right) in enumerate(edges):
        near = edges[:j]
        touch = (near[:, 0] < bottom) & (near[:, 1] > top) & (near[:, 2] < right) & (near[:, 3] > left)
        for i in np.flatnonzero(touch):
            rows = slice(max(top, edges[i, 0]), min(bottom, edges[i, 1]))
            columns = slice(max(left, edges[i, 2]), min(right, edges[i, 3]))
            both = _cut(masks[j], edges[j], rows, columns) & _cut(masks[i], edges[i], rows, columns)
            if both.sum() >= max(least, part * min(area[i], area[j])):
                pairs.append((i, j))
    return np.array(pairs, np.int32).reshape(-1, 2)


def _cut(mask: Array, edge: Array, rows: slice, columns: slice) -> Array:
    top, left = edge[0], edge[2]
    return mask[rows.start - top : rows.stop - top, columns.start - left : columns.stop - left]
