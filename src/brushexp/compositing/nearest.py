"""Find the nearest point on a curve for each of a tile's 64 pixels, and store it for the backward pass."""
# mypy: allow-untyped-defs

import numpy as np

from brushexp.compat.compiled import inline
from brushexp.compositing.tile_lists import AREA, CENTER_X, CENTER_Y, NEAREST, TILE, F

MIDDLE = F(0.5 * TILE)
HALF_DIAGONAL = F(np.sqrt(0.5) * (TILE - 1) * 1.001)
PLACES = (np.arange(16, dtype=F) + F(0.5)) * F(1 / 16)
LEAST_SLOPE = F(1e-6)  # smallest second derivative by which Newton's method divides, relative to the curve's size
LAST = F(1 / 32)  # largest of the last steps of Halley's method, as a fraction of the curve
TIE = F(3e-7)  # fraction of the curve's length; within it, two legs of a fold are equally near and the first is chosen


@inline
def _part_near(reach, bx, by, fx, fy, mx, my):
    """Compute a range of t that contains all curve points within ``reach`` of the tile.

    (mx, my) is the start of the curve relative to the tile's centre. It suffices to compare 16 sampled points with this
    centre, because every t is within 1/32 of a sampled t, and every pixel centre is within half a diagonal of the
    tile's centre.
    """
    fastest = max(fx * fx + fy * fy, (fx + bx) * (fx + bx) + (fy + by) * (fy + by))
    far = reach + HALF_DIAGONAL + np.sqrt(fastest) * F(1.01 / 16)
    first, last = 16, -1
    for k in range(16):
        t = PLACES[k]
        x, y = (bx * t + F(2) * fx) * t + mx, (by * t + F(2) * fy) * t + my
        near = x * x + y * y < far * far
        first, last = min(first, k if near else 16), max(last, k if near else -1)
    if first > last:
        return F(0), F(1)
    return F(first) * F(1 / 16), F(last + 1) * F(1 / 16)


@inline
def _evenness(a, b, c0, bx, by, mx, my, low, high):
    """Compute the ratio of the smallest to the largest slope of f, the cubic that is zero at the nearest points.

    The slopes are taken over all t from ``low`` to ``high`` and all pixels of a tile. A ratio of 1 means that f is
    linear. If the ratio is positive, each pixel has exactly one nearest point in that range.
    """
    turn = min(max(-b / (F(3) * a + F(1e-20)), low), high)
    spread = F(0.5 * (TILE - 1)) * (abs(bx) + abs(by))
    c = c0 + bx * mx + by * my
    least = (F(3) * a * turn + F(2) * b) * turn + c - spread
    return least / max(_greatest_slope(a, b, c0, bx, by, mx, my, low, high), F(1e-20))


@inline
def _greatest_slope(a, b, c0, bx, by, mx, my, low, high):
    """Compute the largest derivative of f between ``low`` and ``high``, over all pixels of a tile."""
    spread = F(0.5 * (TILE - 1)) * (abs(bx) + abs(by))
    ends = max((F(3) * a * low + F(2) * b) * low, (F(3) * a * high + F(2) * b) * high)
    return ends + c0 + bx * mx + by * my + spread


@inline
def _constant(a, b, c0, t):
    """Compute the part of the squared distance at parameter ``t`` that all pixels share, divided by 4 ``t``."""
    return (F(0.25) * a * t + b * F(1 / 3)) * t * t + F(0.5) * c0 * t


@inline
def _find_from_middle(a, b, c0, bx, by, fx, fy, sx, sy, low, high, own):
    """Find nearest points by Newton's method, starting at the middle of the range."""
    floor, middle = LEAST_SLOPE * (a + abs(b) + c0) + F(1e-20), F(0.5) * (low + high)
    for q in range(AREA):
        mx, my = sx - CENTER_X[q], sy - CENTER_Y[q]
        c, d = c0 + bx * mx + by * my, fx * mx + fy * my
        own[NEAREST * AREA + q] = _three_steps(a, b, c, d, floor, middle, low, high)


@inline
def _find_from_five(a, b, c0, bx, by, fx, fy, sx, sy, low, high, own):
    """Find nearest points by Newton's method, starting at the best of five parameters."""
    floor, step = LEAST_SLOPE * (a + abs(b) + c0) + F(1e-20), F(0.25) * (high - low)
    shared, first = _four(a, b, c0, low + step, step), _constant(a, b, c0, low)
    for q in range(AREA):
        mx, my = sx - CENTER_X[q], sy - CENTER_Y[q]
        bend, d = F(0.5) * (bx * mx + by * my), fx * mx + fy * my
        best, t = _best_of_four(low + step, step, bend, d, shared)
        t = t if best < (bend * low + d + first) * low else low
        least, most, c = max(t - step, low), min(t + step, high), c0 + F(2) * bend
        own[NEAREST * AREA + q] = _three_steps(a, b, c, d, floor, t, least, most)


@inline
def _find_from_nine(a, b, c0, bx, by, fx, fy, sx, sy, low, high, own):
    """Find nearest points by Newton's method, starting at the best of nine parameters."""
    floor, step = LEAST_SLOPE * (a + abs(b) + c0) + F(1e-20), F(0.125) * (high - low)
    odd, even = _four(a, b, c0, low + step, F(2) * step), _four(a, b, c0, low + F(2) * step, F(2) * step)
    first = _constant(a, b, c0, low)
    for q in range(AREA):
        mx, my = sx - CENTER_X[q], sy - CENTER_Y[q]
        bend, d = F(0.5) * (bx * mx + by * my), fx * mx + fy * my
        best, t = _best_of_four(low + step, F(2) * step, bend, d, odd)
        other, u = _best_of_four(low + F(2) * step, F(2) * step, bend, d, even)
        best, t = (best, t) if best < other else (other, u)
        t = t if best < (bend * low + d + first) * low else low
        least, most, c = max(t - step, low), min(t + step, high), c0 + F(2) * bend
        own[NEAREST * AREA + q] = _three_steps(a, b, c, d, floor, t, least, most)


@inline
def _four(a, b, c0, t, step):
    """Compute `_constant` at ``t`` and at three more parameters, spaced by ``step``."""
    u, v, w = t + step, t + F(2) * step, t + F(3) * step
    return _constant(a, b, c0, t), _constant(a, b, c0, u), _constant(a, b, c0, v), _constant(a, b, c0, w)


@inline
def _best_of_four(t, step, bend, forward, shared):
    """Return (|B(t) - p|^2 - |P0 - p|^2) / 4 at the best of four parameters t, and that parameter."""
    u, v, w = t + step, t + F(2) * step, t + F(3) * step
    at_t, at_u = (bend * t + forward + shared[0]) * t, (bend * u + forward + shared[1]) * u
    at_v, at_w = (bend * v + forward + shared[2]) * v, (bend * w + forward + shared[3]) * w
    near, t_near = (at_t, t) if at_t < at_u else (at_u, u)
    other, t_other = (at_v, v) if at_v < at_w else (at_w, w)
    return (near, t_near) if near < other else (other, t_other)


@inline
def _three_steps(a, b, c, d, floor, t, low, high):
    """Take three steps of Newton's method, unrolled because a loop would prevent vectorisation over the pixels."""
    t = _newton(a, b, c, d, floor, t, low, high)
    t = _newton(a, b, c, d, floor, t, low, high)
    return _newton(a, b, c, d, floor, t, low, high)


@inline
def _newton(a, b, c, d, floor, t, low, high):
    f = ((a * t + b) * t + c) * t + d
    g = (F(3) * a * t + F(2) * b) * t + c
    return min(max(t - f / max(g, floor), low), high)


@inline
def _halley(a, b, c, d, t):
    """Compute the amount that one step of Halley's method subtracts from ``t``."""
    f, g = ((a * t + b) * t + c) * t + d, max((F(3) * a * t + F(2) * b) * t + c, LEAST_SLOPE)
    return F(2) * f * g / max(F(2) * g * g - f * (F(6) * a * t + F(2) * b), g * g)


@inline
def _valley(a, b, c, d, t, low, high):
    """Take five steps of Halley's method from one end of the range, unrolled for the same reason as `_three_steps`."""
    t = min(max(t - _halley(a, b, c, d, t), low), high)
    t = min(max(t - _halley(a, b, c, d, t), low), high)
    t = min(max(t - _halley(a, b, c, d, t), low), high)
    t = min(max(t - _halley(a, b, c, d, t), low), high)
    return min(max(t - _halley(a, b, c, d, t), low), high)


@inline
def _find_from_ends(a, b, c0, bx, by, fx, fy, sx, sy, low, high, own):
    """Find both minima of the distance by Halley's method, starting from each end, and choose the nearer one.

    The derivative of the squared distance is a cubic with a positive leading coefficient. Its outermost zeros are the
    minima, one on each side of its inflection point. Between an end of the range and the minimum on that side, the
    cubic has no other zero, and the sign of its curvature does not change.
    """
    size = a + abs(b) + c0 + F(1e-20)
    unit = F(1) / size  # keeps squares from overflowing
    a, b, c0 = a * unit, b * unit, c0 * unit
    tie = TIE * np.sqrt(size)
    turn = min(max(-b / (F(3) * a + F(1e-20)), low), high)
    for q in range(AREA):
        mx, my = sx - CENTER_X[q], sy - CENTER_Y[q]
        c, d = c0 + (bx * mx + by * my) * unit, (fx * mx + fy * my) * unit
        t, u = _valley(a, b, c, d, low, low, turn), _valley(a, b, c, d, high, turn, high)
        tx, ty = (bx * t + F(2) * fx) * t + mx, (by * t + F(2) * fy) * t + my
        ux, uy = (bx * u + F(2) * fx) * u + mx, (by * u + F(2) * fy) * u + my
        nearer = np.sqrt(tx * tx + ty * ty) <= np.sqrt(ux * ux + uy * uy) + tie
        own[NEAREST * AREA + q] = t if nearer else u
    for q in range(AREA):  # two more steps for the nearer minimum, limited because the derivative may be flat there
        mx, my = sx - CENTER_X[q], sy - CENTER_Y[q]
        c, d = c0 + (bx * mx + by * my) * unit, (fx * mx + fy * my) * unit
        t = own[NEAREST * AREA + q]
        least, most = (low, turn) if t <= turn else (turn, high)
        t = min(max(t - min(max(_halley(a, b, c, d, t), -LAST), LAST), least), most)
        own[NEAREST * AREA + q] = min(max(t - min(max(_halley(a, b, c, d, t), -LAST), LAST), least), most)


@inline
def find_nearest(p, i, reach, ox, oy, own, near, j, keep):
    """Part `seek`: write to row NEAREST the parameter of the point on stroke ``i`` nearest to each pixel of the tile.

    If ``keep``, a copy for the backward pass is stored in 16 bits, in steps of 1/65535; alpha, t and distance in 32
    bits would take six times as much memory.
    """
    sx, sy, cx, cy, ex, ey = p[i, 0] - ox, p[i, 1] - oy, p[i, 2] - ox, p[i, 3] - oy, p[i, 4] - ox, p[i, 5] - oy
    bx, by, fx, fy = sx - F(2) * cx + ex, sy - F(2) * cy + ey, cx - sx, cy - sy
    a, b, c0 = bx * bx + by * by, F(3) * (bx * fx + by * fy), F(2) * (fx * fx + fy * fy)
    low, high = _part_near(reach, bx, by, fx, fy, sx - MIDDLE, sy - MIDDLE)
    even = _evenness(a, b, c0, bx, by, sx - MIDDLE, sy - MIDDLE, low, high)
    # On random curves this finds the distance of pixels within 40 px to 3e-4 px; the less even f is, the more starts it
    # needs.
    if even > F(0.5):
        _find_from_middle(a, b, c0, bx, by, fx, fy, sx, sy, low, high, own)
    elif even > F(0.12):
        _find_from_five(a, b, c0, bx, by, fx, fy, sx, sy, low, high, own)
    elif even > F(0.05):
        _find_from_nine(a, b, c0, bx, by, fx, fy, sx, sy, low, high, own)
    else:
        _find_from_ends(a, b, c0, bx, by, fx, fy, sx, sy, low, high, own)
    if keep:
        row = near[j]
        for q in range(AREA):
            row[q] = np.uint16(own[NEAREST * AREA + q] * F(65535) + F(0.5))


@inline
def recall_nearest(p, i, ox, oy, own, near, j):
    """Part `recall`: restore the parameters stored by `find_nearest`, and reduce their rounding error by a Newton step.

    Two Newton iterations compute 1 / slope, starting from a lower bound, so that the result is never too large. A
    negative slope is treated as 0, because the nearest point is then an end of the curve; all slopes in a tile may be
    negative.
    """
    row = near[j]
    sx, sy, cx, cy, ex, ey = p[i, 0] - ox, p[i, 1] - oy, p[i, 2] - ox, p[i, 3] - oy, p[i, 4] - ox, p[i, 5] - oy
    bx, by, fx, fy = sx - F(2) * cx + ex, sy - F(2) * cy + ey, cx - sx, cy - sy
    a, b, c0 = bx * bx + by * by, F(3) * (bx * fx + by * fy), F(2) * (fx * fx + fy * fy)
    greatest = _greatest_slope(a, b, c0, bx, by, sx - MIDDLE, sy - MIDDLE, F(0), F(1))
    least = F(1) / (max(greatest, F(0)) + F(1e-20))
    for q in range(AREA):
        mx, my = sx - CENTER_X[q], sy - CENTER_Y[q]
        c, d = c0 + bx * mx + by * my, fx * mx + fy * my
        kept = F(row[q]) * F(1 / 65535)
        f = ((a * kept + b) * kept + c) * kept + d
        g = max((F(3) * a * kept + F(2) * b) * kept + c, F(0))
        one = least * (F(2) - g * least)
        one = one * (F(2) - g * one)
        t = kept - min(max(f * one, F(-1e-5)), F(1e-5))
        own[NEAREST * AREA + q] = min(max(t, F(0)), F(1))
