"""List the strokes that touch each tile, front to back, in compiled code.

Each (tile, stroke) pair has two indices: its position in the tile's list, and its slot in the stroke's row of pairs.
Kernels write gradients to the slots, which are then summed per stroke without atomics and always in the same order.
"""
# mypy: allow-untyped-defs

from dataclasses import dataclass
from typing import Any

import numpy as np
from torch import Tensor

from brushexp.compat.compiled import function, inline
from brushexp.system.runtime import share

F = np.float32
TILE = 8  # pixels
AREA = TILE * TILE
CENTER_X = np.tile(np.arange(TILE, dtype=F) + F(0.5), TILE)  # pixel centres of a tile, relative to its corner
CENTER_Y = np.repeat(np.arange(TILE, dtype=F) + F(0.5), TILE)
ABOVE, NEAREST = 0, 1  # rows of a stroke in a tile: the light above it, and the nearest parameter of its curve
PIECES = 4  # straight pieces that approximate a curve when tiles are tested
BANDS = 16  # bands of tile rows that are filled independently; fixed, so that slots do not depend on the thread count

WORKERS = 64  # enough to share the work evenly
RUN = 16  # consecutive tiles that a worker paints one after the other, so that it loads each line of memory once

Array = np.ndarray[Any, Any]


@dataclass(frozen=True)
class TileLists:
    """The (tile, stroke) pairs on a canvas, listed by tile and by stroke."""

    first: Array  # (tiles + 1,) where each tile's list begins in ``stroke`` and ``slot``; tiles go row by row
    stroke: Array  # (pairs,) index of the stroke, front to back within a tile
    slot: Array  # (pairs,) place of the pair when pairs are sorted by stroke
    row: Array  # (N + 1,) where each stroke's slots begin
    shape: tuple[int, int]  # tile rows and columns


def tile_lists(
    curve: Tensor, reach: Tensor, front_to_back: Tensor, size: tuple[int, int], *, boxes_only: bool = False
) -> TileLists:
    """List the strokes that may touch each tile of a canvas of ``size`` (H, W).

    ``curve`` (N, 3, 2) and ``reach`` (N,) are as in `Layers`; ``front_to_back`` (N,) holds the indices of the
    strokes, top stroke first, and the lists contain positions in this order. With ``boxes_only``, every stroke fills
    its bounding box, including the corners, as windows do.
    """
    points, reaches = (part.detach()[front_to_back].float().cpu().contiguous().numpy() for part in (curve, reach))
    rows, columns = -(-size[0] // TILE), -(-size[1] // TILE)
    boxes = _boxes(points, reaches, rows, columns)
    space = np.concatenate([np.zeros(1, np.int64), np.cumsum((boxes[2] - boxes[0] + 1) * (boxes[3] - boxes[1] + 1))])
    per_tile = np.zeros(rows * columns, np.int64)
    per_band = np.zeros((len(reaches), BANDS), np.int64)
    hits = np.empty(space[-1], np.int32)
    share(
        _find, BANDS, points.reshape(-1, 6), reaches, boxes, rows, columns, boxes_only, space, hits, per_tile, per_band
    )
    first = np.concatenate([np.zeros(1, np.int64), np.cumsum(per_tile)])
    ends = np.cumsum(per_band.reshape(-1)).reshape(per_band.shape)
    row = np.concatenate([np.zeros(1, np.int64), ends[:, -1]])
    stroke, slot = np.empty(first[-1], np.int32), np.empty(first[-1], np.int64)
    share(_fill, BANDS, hits, space, boxes, rows, first[:-1].copy(), ends - per_band, per_band, stroke, slot)
    return TileLists(first, stroke, slot, row, (rows, columns))


def _boxes(curve, reach, rows, columns):
    """Compute each stroke's bounding rectangle (4, N) in tiles: left, top, right, bottom, inclusive.

    If a stroke does not touch any tile, right < left.
    """
    start, control, end = np.ascontiguousarray(curve.transpose(1, 2, 0))  # (2, N)
    middle, bend = (start + 2 * control + end) / 4, start - 2 * control + end
    # A quadratic curve lies within the box around its ends and middle, widened by an eighth of its bend.
    slack, most = reach + abs(bend) / 8, np.array([[columns], [rows]], F) * TILE
    low = np.minimum(np.minimum(start, end), middle) - slack
    high = np.maximum(np.maximum(start, end), middle) + slack
    inside = (reach > 0) & ((high > 0) & (low < most)).all(0)
    first, last = np.where(inside, np.maximum(low, 0), TILE), np.where(inside, np.minimum(high, most - 1), 0)
    return (np.concatenate([first, last]) / TILE).astype(np.int32)


@inline
def _touches(points, reach, x, y):
    """Check whether a polyline with half thickness ``reach`` touches the square of pixel centres around (x, y).

    It does if (x, y) is within ``reach`` of the hexagon that the square sweeps along a piece of the polyline.
    Separating axes alone (along and across) would keep false pairs at corners, an eighth of all pairs.
    """
    half = 0.5 * (TILE - 1)
    for m in range(PIECES):
        ax, ay, bx, by = points[m, 0], points[m, 1], points[m + 1, 0], points[m + 1, 1]
        outside_x = max(min(ax, bx) - x, x - max(ax, bx)) - half
        outside_y = max(min(ay, by) - y, y - max(ay, by)) - half
        if outside_x > reach or outside_y > reach:
            continue
        ux, uy = bx - ax, by - ay
        length = np.sqrt(ux * ux + uy * uy)
        if length > 1e-6:
            ux, uy = ux / length, uy / length
        else:
            ux, uy = 1.0, 0.0
        across = ux * (y - ay) - uy * (x - ax)
        beside = abs(across) - half * (abs(ux) + abs(uy))
        if beside > reach:
            continue
        if outside_x <= 0 and outside_y <= 0 and beside <= 0:
            return True
        if _near_square(x - ax, y - ay, half, reach) or _near_square(x - bx, y - by, half, reach):
            return True
        # Only the two long sides remain; the nearer one starts at this corner of the square around a.
        side = half if across > 0 else -half
        corner_x, corner_y = (-side if uy > 0 else side), (side if ux > 0 else -side)
        along = ux * (x - ax - corner_x) + uy * (y - ay - corner_y)
        if 0 <= along <= length and beside <= reach:
            return True
    return False


@inline
def _sample(curve, reach, xs, ys):
    """Sample a curve relative to its start, at 16 points per 40 px and at most 64, and return the number of points.

    Also returns the square of a distance within which every point that ``reach`` covers has a sampled point. This bound
    relies on the fact that the offset of a point from the nearest point on the curve is perpendicular to the curve,
    unless the nearest point is an end; the ends are sampled.
    """
    sx, sy, cx, cy, ex, ey = curve
    fx, fy, bx, by = 2 * (cx - sx), 2 * (cy - sy), sx - 2 * cx + ex, sy - 2 * cy + ey
    fastest = np.sqrt(max(fx * fx + fy * fy, (fx + 2 * bx) * (fx + 2 * bx) + (fy + 2 * by) * (fy + 2 * by)))
    count = 16 * (1 + int(min(fastest / 40, 3.0)))
    for k in range(count):
        t = F(k) / F(count - 1)
        xs[k], ys[k] = (F(bx) * t + F(fx)) * t, (F(by) * t + F(fy)) * t
    step = 0.51 / (count - 1)
    near = fastest * step
    return count, F(reach * reach + near * near + 2 * reach * np.sqrt(bx * bx + by * by) * step * step + 0.01)


@inline
def _glance(xs, ys, count, x, y, within, beyond):
    """Compare the distances between sampled curve points and the square around (x, y) with two squared distances.

    Returns 1000 or more if any point is no farther than ``within``, 1 or more if any is no farther than ``beyond``, and
    otherwise 0.
    """
    total, half = F(0), F(0.5 * (TILE - 1))
    for k in range(count):
        dx, dy = max(abs(xs[k] - x) - half, F(0)), max(abs(ys[k] - y) - half, F(0))
        square = dx * dx + dy * dy
        total += F(1000) if square <= within else (F(1) if square <= beyond else F(0))
    return total


@inline
def _near_square(x, y, half, reach):
    """Check whether (x, y) is within ``reach`` of the square that extends from -half to half."""
    dx, dy = max(abs(x) - half, 0.0), max(abs(y) - half, 0.0)
    return dx * dx + dy * dy <= reach * reach


@inline
def _flatten(curve, points):
    """Approximate a curve by a polyline of PIECES + 1 points, and return a bound on the distance between the two."""
    sx, sy, cx, cy, ex, ey = curve
    for m in range(PIECES + 1):
        t = m / PIECES
        v = 1 - t
        points[m, 0] = v * v * sx + 2 * t * v * cx + t * t * ex
        points[m, 1] = v * v * sy + 2 * t * v * cy + t * t * ey
    bx, by = sx - 2 * cx + ex, sy - 2 * cy + ey
    return np.sqrt(bx * bx + by * by) / (4 * PIECES * PIECES)


@function
def _find(first_band, end_band, curve, reach, boxes, rows, columns, boxes_only, space, hits, per_tile, per_band):
    """Test the tiles in strokes' bounding boxes within a range of bands; record and count the tiles that are touched.

    Starting at ``space[i]``, ``hits`` has room for all tiles in the bounding box of stroke ``i``, row by row, so that
    no two bands share memory.
    """
    for band in range(first_band, end_band):
        low, high = band * rows // BANDS, (band + 1) * rows // BANDS
        points, xs, ys = np.empty((PIECES + 1, 2), np.float64), np.empty(64, F), np.empty(64, F)
        for i in range(len(curve)):
            left, right = boxes[0, i], boxes[2, i]
            top, bottom = max(boxes[1, i], low), min(boxes[3, i], high - 1)
            if top > bottom:
                continue
            r = reach[i] + _flatten(curve[i], points)
            count, beyond = _sample(curve[i], reach[i], xs, ys)
            begin = space[i] + (top - boxes[1, i]) * (right - left + 1)
            place = begin
            for ty in range(top, bottom + 1):
                for tx in range(left, right + 1):
                    x, y = (tx + 0.5) * TILE, (ty + 0.5) * TILE
                    seen = _glance(xs, ys, count, F(x - curve[i, 0]), F(y - curve[i, 1]), reach[i] * reach[i], beyond)
                    if boxes_only or seen >= F(1000) or (seen > F(0) and _touches(points, r, x, y)):
                        tile = ty * columns + tx
                        hits[place] = tile
                        per_tile[tile] += 1
                        place += 1
            per_band[i, band] = place - begin


@function
def _fill(first_band, end_band, hits, space, boxes, rows, place, row, per_band, stroke, slot):
    """Sort a range of bands' hits, which are grouped by stroke, into the lists by tile and by stroke."""
    for band in range(first_band, end_band):
        low = band * rows // BANDS
        for i in range(len(row)):
            begin = space[i] + max(low - boxes[1, i], 0) * (boxes[2, i] - boxes[0, i] + 1)
            for k in range(per_band[i, band]):
                tile = hits[begin + k]
                stroke[place[tile]] = i
                slot[place[tile]] = row[i, band] + k
                place[tile] += 1


@inline
def most_tiles(used):
    """Return the largest number of tiles assigned to a worker."""
    return (len(used) + RUN * WORKERS - 1) // (RUN * WORKERS) * RUN


@inline
def tile_of(worker, k):
    """Return the index of a worker's tile ``k``; it ascends with ``k``, and may exceed the index of the last tile."""
    return (k // RUN * WORKERS + worker) * RUN + k % RUN
