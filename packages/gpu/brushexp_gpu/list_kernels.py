"""Kernels that find the strokes touching each tile; see `lists`."""
# mypy: allow-untyped-defs

import math

import triton.language as tl
from triton import jit

from brushexp_gpu.curves import CURVE_PARTS, TILE
from brushexp_gpu.launch import inline

HALF = tl.constexpr(0.5 * (TILE.value - 1))  # distance from a tile's centre to its outermost pixel centres
HALF_DIAGONAL = tl.constexpr(math.sqrt(0.5) * (TILE.value - 1) * 1.001)
STEP = tl.constexpr(40.0)  # pixels of curve per PARTS points
MOST_POINTS = tl.constexpr(16.0)  # maximum number of points per curve, in PARTS
HALVINGS = tl.constexpr(32)  # enough bisections for any number of pairs


@inline
def _box(start, control, end, reach, tiles):
    """Find the first and last pixels of the canvas that a stroke may reach along an axis, and whether it reaches any.

    A quadratic curve is contained in the bounding box of its ends and its midpoint, widened by an eighth of its bend.
    """
    middle, slack = (start + 2.0 * control + end) / 4.0, reach + tl.abs(start - 2.0 * control + end) / 8.0
    low = tl.minimum(tl.minimum(start, end), middle) - slack
    high = tl.maximum(tl.maximum(start, end), middle) + slack
    most = (tiles * TILE).to(tl.float32)
    first, last = tl.maximum(low, 0.0), tl.minimum(high, most - 1.0)
    return first, last, (high > 0.0) & (low < most)


@inline
def _count_at_most(numbers, count, limit, here):
    """Count by bisection how many of ``count`` ascending numbers do not exceed ``limit``."""
    low, high = tl.zeros_like(limit), tl.where(here, count, 0).to(limit.dtype)
    for _ in range(0, HALVINGS):
        middle, open = (low + high) // 2, low < high
        below = open & (tl.load(numbers + middle, open, 0) <= limit)
        low, high = tl.where(below, middle + 1, low), tl.where(open & ~below, middle, high)
    return low


@jit(do_not_specialize=["n", "rows", "columns"])
def box_kernel(curve, reach, order, boxes, sizes, n, rows, columns, BLOCK: tl.constexpr):
    """Write the rectangle of tiles around each stroke, by depth: left, top and number of columns in ``boxes`` (3, n).

    ``sizes`` (n + 1,) receives a 0 followed by the number of tiles in each rectangle.
    """
    k = tl.program_id(0) * BLOCK + tl.arange(0, BLOCK)
    here = k < n
    i = tl.load(order + k, here, 0)
    r, at = tl.load(reach + i, here, 0.0), curve + 6 * i
    left, right, meets_x = _box(
        tl.load(at, here, 0.0), tl.load(at + 2, here, 0.0), tl.load(at + 4, here, 0.0), r, columns
    )
    top, bottom, meets_y = _box(
        tl.load(at + 1, here, 0.0), tl.load(at + 3, here, 0.0), tl.load(at + 5, here, 0.0), r, rows
    )
    meets = (r > 0.0) & meets_x & meets_y & here
    left, top = tl.where(meets, left, 0.0).to(tl.int32) // TILE, tl.where(meets, top, 0.0).to(tl.int32) // TILE
    wide = tl.where(meets, right, 0.0).to(tl.int32) // TILE - left + 1
    high = tl.where(meets, bottom, 0.0).to(tl.int32) // TILE - top + 1
    tl.store(boxes + k, left, here)
    tl.store(boxes + n + k, top, here)
    tl.store(boxes + 2 * n + k, wide, here)
    tl.store(sizes + k, 0, k == 0)
    tl.store(sizes + k + 1, tl.where(meets, wide * high, 0), here)


@jit(do_not_specialize=["n", "pairs", "tiles", "columns"])
def find_kernel(curve, reach, order, boxes, space, tile, stroke, part, n, pairs, tiles, columns, BLOCK: tl.constexpr):
    """Write ``tile``, ``stroke`` and ``part`` for each pair of a stroke and a tile in its rectangle.

    Whether a curve comes within reach of a tile is decided from points sampled along it: its ends, and points at most
    2.5 px apart. If no point is close enough to the square of the tile's pixel centres, ``tile`` is set to ``tiles``,
    which means none. A curve has CURVE_PARTS parts; ``part`` encodes a range of parts that contains every point within
    reach of the tile, as the first part plus 256 times the part after the last.
    """
    pair = tl.program_id(0) * BLOCK + tl.arange(0, BLOCK)
    here = pair < pairs
    k = tl.where(here, _count_at_most(space, n + 1, pair.to(tl.int64), here) - 1, 0)
    i, offset = tl.load(order + k, here, 0), (pair - tl.load(space + k, here, 0)).to(tl.int32)
    wide = tl.load(boxes + 2 * n + k, here, 1)
    tx, ty = tl.load(boxes + k, here, 0) + offset % wide, tl.load(boxes + n + k, here, 0) + offset // wide
    x, y, at = (tx.to(tl.float32) + 0.5) * TILE, (ty.to(tl.float32) + 0.5) * TILE, curve + 6 * i
    sx, sy = tl.load(at, here, 0.0), tl.load(at + 1, here, 0.0)
    cx, cy = tl.load(at + 2, here, 0.0), tl.load(at + 3, here, 0.0)
    ex, ey, r = tl.load(at + 4, here, 0.0), tl.load(at + 5, here, 0.0), tl.load(reach + i, here, 0.0)
    fx, fy, bx, by = 2.0 * (cx - sx), 2.0 * (cy - sy), sx - 2.0 * cx + ex, sy - 2.0 * cy + ey
    mx, my = sx - x, sy - y
    fastest = tl.sqrt(tl.maximum(fx * fx + fy * fy, (fx + 2 * bx) * (fx + 2 * bx) + (fy + 2 * by) * (fy + 2 * by)))
    # The offset from the nearest point is perpendicular to the curve unless that point is an end.
    points = CURVE_PARTS * (1 + tl.minimum(fastest / STEP, MOST_POINTS - 1.0).to(tl.int32))
    step = 0.51 / (points - 1).to(tl.float32)
    beyond = r * r + fastest * fastest * step * step + 2.0 * r * tl.sqrt(bx * bx + by * by) * step * step + 0.01
    near = tl.full((BLOCK,), float("inf"), tl.float32)
    for m in range(0, tl.max(points)):
        t = tl.minimum(m / (points - 1).to(tl.float32), 1.0)
        dx = tl.maximum(tl.abs((bx * t + fx) * t + mx) - HALF, 0.0)
        dy = tl.maximum(tl.abs((by * t + fy) * t + my) - HALF, 0.0)
        near = tl.minimum(near, dx * dx + dy * dy)
    low, high = tl.full((BLOCK,), CURVE_PARTS, tl.int32), tl.zeros((BLOCK,), tl.int32)
    far = r + HALF_DIAGONAL + fastest * 0.5 * 1.01 / CURVE_PARTS
    for m in tl.static_range(CURVE_PARTS):
        t = (m + 0.5) / CURVE_PARTS
        dx, dy = (bx * t + fx) * t + mx, (by * t + fy) * t + my
        within = dx * dx + dy * dy < far * far
        low, high = tl.where(within, tl.minimum(low, m), low), tl.where(within, m + 1, high)
    tl.store(tile + pair, tl.where(near <= beyond, ty * columns + tx, tiles), here)
    tl.store(stroke + pair, i, here)
    tl.store(part + pair, tl.where(low < high, low + 256 * high, 256 * CURVE_PARTS), here)


@jit(do_not_specialize=["pairs", "tiles"])
def arrange_kernel(
    tile, slot, found, near, stroke, part, first, sizes, pairs, tiles, CHUNK: tl.constexpr, BLOCK: tl.constexpr
):
    """Write the lists of pairs, sorted by ``tile``; ``slot`` is each pair's index in the output of `find_kernel`.

    ``stroke`` receives the values of ``found`` in sorted order, and ``part`` those of ``near``. ``first`` (tiles + 1,)
    receives the start of each list, and ``sizes`` (tiles + 1,) a 0 followed by the number of chunks in each list.
    """
    at = tl.program_id(0) * BLOCK + tl.arange(0, BLOCK)
    here = at < pairs
    source = tl.load(slot + at, here, 0)
    tl.store(stroke + at, tl.load(found + source, here, 0), here)
    tl.store(part + at, tl.load(near + source, here, 0), here)
    listed = at <= tiles
    begin, end = _count_at_most(tile, pairs, at - 1, listed), _count_at_most(tile, pairs, at, listed)
    tl.store(first + at, begin.to(tl.int64), listed)
    tl.store(sizes + at, 0, at == 0)
    tl.store(sizes + at + 1, (end - begin + CHUNK - 1) // CHUNK, at < tiles)
