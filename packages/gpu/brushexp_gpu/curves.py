"""Locate pixels relative to curves, for several tiles at once, in functions that kernels inline.

Arrays with one value per stroke have the shape (TILES, 1), and those with one value per pixel (TILES, AREA); row k
belongs to the k-th tile of a program. The formulas are the same as in the modules `nearest` and `texture_places` of
`brushexp.compositing`.
"""
# mypy: allow-untyped-defs

import triton.language as tl

from brushexp.contracts.kernels import nearest as processor
from brushexp.contracts.kernels import tile_lists
from brushexp_gpu.launch import inline

TILE = tl.constexpr(tile_lists.TILE)
AREA = tl.constexpr(tile_lists.AREA)
LEAST_SLOPE = tl.constexpr(float(processor.LEAST_SLOPE))
LAST = tl.constexpr(float(processor.LAST))
TIE = tl.constexpr(float(processor.TIE))
CURVE_PARTS = tl.constexpr(16)  # number of parts of a curve; the lists say which parts come near the tile


@inline
def pixels():
    """Return the x and y coordinates (1, AREA) of a tile's pixel centres, relative to its corner."""
    q = tl.arange(0, AREA)[None, :]
    return (q % TILE).to(tl.float32) + 0.5, (q // TILE).to(tl.float32) + 0.5


@inline
def load_curve(p, i, ox, oy, here):
    """Load x and y of curves at ``p`` + ``i``: start relative to (ox, oy), vector from start to control, and bend."""
    sx, sy = tl.load(p + i, here, 0.0) - ox, tl.load(p + i + 1, here, 0.0) - oy
    cx, cy = tl.load(p + i + 2, here, 0.0) - ox, tl.load(p + i + 3, here, 0.0) - oy
    ex, ey = tl.load(p + i + 4, here, 0.0) - ox, tl.load(p + i + 5, here, 0.0) - oy
    fx, fy, bx, by = cx - sx, cy - sy, sx - 2.0 * cx + ex, sy - 2.0 * cy + ey
    return sx[:, None], sy[:, None], fx[:, None], fy[:, None], bx[:, None], by[:, None]


@inline
def clip(x, low, high):
    """Clamp ``x`` to the range from ``low`` to ``high``."""
    return tl.minimum(tl.maximum(x, low), high)


@inline
def halley(a, b, c, d, t):
    """Compute the step that Halley's method subtracts from ``t``, for the cubic with coefficients ``a`` to ``d``."""
    f, g = ((a * t + b) * t + c) * t + d, tl.maximum((3.0 * a * t + 2.0 * b) * t + c, LEAST_SLOPE)
    return 2.0 * f * g / tl.maximum(2.0 * g * g - f * (6.0 * a * t + 2.0 * b), g * g)


@inline
def valley(a, b, c, d, t, low, high):
    """Take five steps of Halley's method from ``t``, each clamped to the range from ``low`` to ``high``."""
    for _ in tl.static_range(5):
        t = clip(t - halley(a, b, c, d, t), low, high)
    return t


@inline
def find_nearest(sx, sy, fx, fy, bx, by, low, high, x, y):
    """Find the parameters, from ``low`` to ``high``, of the nearest points: the nearer of two minima of the distance.

    All curves use the search that the CPU uses only for strongly bent curves; a branch would cost more than it saves.
    """
    a, b, c0 = bx * bx + by * by, 3.0 * (bx * fx + by * fy), 2.0 * (fx * fx + fy * fy)
    size = a + tl.abs(b) + c0 + 1e-20
    unit = 1.0 / size  # prevents overflow of squares
    tie = tl.sqrt(size) * TIE
    a, b, c0 = a * unit, b * unit, c0 * unit
    turn = clip(-b / (3.0 * a + 1e-20), low, high)
    mx, my = sx - x, sy - y
    c, d = c0 + (bx * mx + by * my) * unit, (fx * mx + fy * my) * unit
    t, u = valley(a, b, c, d, low, low, turn), valley(a, b, c, d, high, turn, high)
    tx, ty = (bx * t + 2.0 * fx) * t + mx, (by * t + 2.0 * fy) * t + my
    ux, uy = (bx * u + 2.0 * fx) * u + mx, (by * u + 2.0 * fy) * u + my
    t = tl.where(tl.sqrt(tx * tx + ty * ty) <= tl.sqrt(ux * ux + uy * uy) + tie, t, u)
    least, most = tl.where(t <= turn, low, turn), tl.where(t <= turn, turn, high)
    for _ in tl.static_range(2):  # where the derivative is flat, a step must not leave the nearer minimum
        t = clip(t - clip(halley(a, b, c, d, t), -LAST, LAST), least, most)
    return t


@inline
def sum_pixels(values):
    """Sum values (TILES, AREA) over each tile's pixels, always in the same order."""
    return tl.sum(values, axis=1)


@inline
def store_moments(out, x0, x1, x2, y0, y1, y2, here):
    """Write the gradient of the control points, given the gradients (TILES, AREA) of `load_curve`'s three vectors."""
    x0, x1, x2 = sum_pixels(x0), sum_pixels(x1), sum_pixels(x2)
    y0, y1, y2 = sum_pixels(y0), sum_pixels(y1), sum_pixels(y2)
    tl.store(out, x0 - x1 + x2, here)
    tl.store(out + 1, y0 - y1 + y2, here)
    tl.store(out + 2, x1 - 2.0 * x2, here)
    tl.store(out + 3, y1 - 2.0 * y2, here)
    tl.store(out + 4, x2, here)
    tl.store(out + 5, y2, here)
