"""The nearest point of a curve for the 64 pixels of a tile, and how it is kept for the backward pass."""
# mypy: allow-untyped-defs

import numpy as np

from brushexp.compat.compiled import inline
from brushexp.compositing.tile_lists import AREA, NEAREST, F

LEAST_SLOPE = F(1e-6)  # least second derivative Newton divides by, against the curve's own size
LAST = F(1 / 32)  # of the curve: Halley's method is as near as that after its steps
TIE = F(3e-7)  # of the curve's length: where both legs of a fold are as near as can be told, the first one is taken


@inline
def _bends(bend, chord):
    """0 for nearly straight, 1 for gently bent and 2 for strongly bent, from the squared lengths of bend and chord.

    Measured on random pixels within reach of random curves: the distance to a gently bent one is within 1e-3 px.
    """
    if bend < F(0.04) * chord:
        return 0
    return 1 if bend < F(0.16) * chord else 2


@inline
def _constant(a, b, c0, t):
    """What all pixels share in the squared distance at parameter ``t``."""
    return (F(0.25) * a * t + b * F(1 / 3)) * t * t + F(0.5) * c0 * t


@inline
def _find_from_samples(kind, a, b, c0, bx, by, fx, fy, sx, sy, own):
    """Newton's method from the middle of the curve, or from the best of five places on it."""
    floor = LEAST_SLOPE * (a + abs(b) + c0) + F(1e-20)
    step = F(1)
    if kind == 0:
        for q in range(AREA):
            own[NEAREST * AREA + q] = F(0.5)
    else:
        step = F(0.25)
        k0, k1 = _constant(a, b, c0, F(0.25)), _constant(a, b, c0, F(0.5))
        k2, k3 = _constant(a, b, c0, F(0.75)), _constant(a, b, c0, F(1))
        for q in range(AREA):
            mx, my = sx - F(q & 7) - F(0.5), sy - F(q >> 3) - F(0.5)
            bend, forward = F(0.5) * (bx * mx + by * my), fx * mx + fy * my
            # A quarter of |B(t) - p|^2 - |P0 - p|^2 at the four places, and the best of them and of 0 at t = 0.
            at0, at1 = (bend * F(0.25) + forward + k0) * F(0.25), (bend * F(0.5) + forward + k1) * F(0.5)
            at2, at3 = (bend * F(0.75) + forward + k2) * F(0.75), bend + forward + k3
            low, t_low = (at0, F(0.25)) if at0 < at1 else (at1, F(0.5))
            high, t_high = (at2, F(0.75)) if at2 < at3 else (at3, F(1))
            best, t = (low, t_low) if low < high else (high, t_high)
            own[NEAREST * AREA + q] = t if best < F(0) else F(0)
    for q in range(AREA):
        mx, my = sx - F(q & 7) - F(0.5), sy - F(q >> 3) - F(0.5)
        c, d = c0 + bx * mx + by * my, fx * mx + fy * my
        t = own[NEAREST * AREA + q]
        low, high = max(t - step, F(0)), min(t + step, F(1))
        t = _newton(a, b, c, d, floor, t, low, high)
        t = _newton(a, b, c, d, floor, t, low, high)
        own[NEAREST * AREA + q] = _newton(a, b, c, d, floor, t, low, high)


@inline
def _newton(a, b, c, d, floor, t, low, high):
    f = ((a * t + b) * t + c) * t + d
    g = (F(3) * a * t + F(2) * b) * t + c
    return min(max(t - f / max(g, floor), low), high)


@inline
def _halley(a, b, c, d, t):
    """What Halley's method takes off ``t``."""
    f, g = ((a * t + b) * t + c) * t + d, max((F(3) * a * t + F(2) * b) * t + c, LEAST_SLOPE)
    return F(2) * f * g / max(F(2) * g * g - f * (F(6) * a * t + F(2) * b), g * g)


@inline
def _valley(a, b, c, d, t, low, high):
    """Five steps from an end; written out, as a loop of them would keep that over the pixels from being SIMD code."""
    t = min(max(t - _halley(a, b, c, d, t), low), high)
    t = min(max(t - _halley(a, b, c, d, t), low), high)
    t = min(max(t - _halley(a, b, c, d, t), low), high)
    t = min(max(t - _halley(a, b, c, d, t), low), high)
    return min(max(t - _halley(a, b, c, d, t), low), high)


@inline
def _find_from_ends(a, b, c0, bx, by, fx, fy, sx, sy, own):
    """Halley's method from both ends; the nearer of both valleys of the distance.

    The derivative of the distance is a cubic that rises; its outermost zeros are the valleys, one to each side of its
    inflection, and it is bent away from the ends on both sides, so that nothing lies between an end and its valley.
    """
    size = a + abs(b) + c0 + F(1e-20)
    unit = F(1) / size  # so that no square overflows
    a, b, c0 = a * unit, b * unit, c0 * unit
    tie = TIE * np.sqrt(size)
    turn = min(max(-b / (F(3) * a + F(1e-20)), F(0)), F(1))
    for q in range(AREA):
        mx, my = sx - F(q & 7) - F(0.5), sy - F(q >> 3) - F(0.5)
        c, d = c0 + (bx * mx + by * my) * unit, (fx * mx + fy * my) * unit
        t, u = _valley(a, b, c, d, F(0), F(0), turn), _valley(a, b, c, d, F(1), turn, F(1))
        tx, ty = (bx * t + F(2) * fx) * t + mx, (by * t + F(2) * fy) * t + my
        ux, uy = (bx * u + F(2) * fx) * u + mx, (by * u + F(2) * fy) * u + my
        nearer = np.sqrt(tx * tx + ty * ty) <= np.sqrt(ux * ux + uy * uy) + tie
        own[NEAREST * AREA + q] = t if nearer else u
    for q in range(AREA):  # two steps more for the nearer one; where the derivative is flat they must not throw it away
        mx, my = sx - F(q & 7) - F(0.5), sy - F(q >> 3) - F(0.5)
        c, d = c0 + (bx * mx + by * my) * unit, (fx * mx + fy * my) * unit
        t = own[NEAREST * AREA + q]
        low, high = (F(0), turn) if t <= turn else (turn, F(1))
        t = min(max(t - min(max(_halley(a, b, c, d, t), -LAST), LAST), low), high)
        own[NEAREST * AREA + q] = min(max(t - min(max(_halley(a, b, c, d, t), -LAST), LAST), low), high)


@inline
def find_nearest(p, i, ox, oy, own, near, j, keep):
    """Part `seek`: write to row NEAREST the parameter of the nearest point of stroke ``i`` to each pixel of the tile.

    What is kept for the backward pass are 65535ths: a quarter of what alpha, t and distance would take.
    """
    sx, sy, cx, cy, ex, ey = p[i, 0] - ox, p[i, 1] - oy, p[i, 2] - ox, p[i, 3] - oy, p[i, 4] - ox, p[i, 5] - oy
    bx, by, fx, fy = sx - F(2) * cx + ex, sy - F(2) * cy + ey, cx - sx, cy - sy
    a, b, c0 = bx * bx + by * by, F(3) * (bx * fx + by * fy), F(2) * (fx * fx + fy * fy)
    chord = (ex - sx) * (ex - sx) + (ey - sy) * (ey - sy)
    kind = _bends(a, chord)
    if kind == 2:
        _find_from_ends(a, b, c0, bx, by, fx, fy, sx, sy, own)
    else:
        _find_from_samples(kind, a, b, c0, bx, by, fx, fy, sx, sy, own)
    if keep:
        row = near[j]
        for q in range(AREA):
            row[q] = np.uint16(own[NEAREST * AREA + q] * F(65535) + F(0.5))


@inline
def recall_nearest(p, i, ox, oy, own, near, j):
    """Part `recall`: bring back what `find_nearest` kept; one Newton step makes up for the rounding."""
    row = near[j]
    sx, sy, cx, cy, ex, ey = p[i, 0] - ox, p[i, 1] - oy, p[i, 2] - ox, p[i, 3] - oy, p[i, 4] - ox, p[i, 5] - oy
    bx, by, fx, fy = sx - F(2) * cx + ex, sy - F(2) * cy + ey, cx - sx, cy - sy
    a, b, c0 = bx * bx + by * by, F(3) * (bx * fx + by * fy), F(2) * (fx * fx + fy * fy)
    floor = LEAST_SLOPE * (a + abs(b) + c0) + F(1e-20)
    for q in range(AREA):
        mx, my = sx - F(q & 7) - F(0.5), sy - F(q >> 3) - F(0.5)
        c, d = c0 + bx * mx + by * my, fx * mx + fy * my
        kept = F(row[q]) * F(1 / 65535)
        slope = ((a * kept + b) * kept + c) * kept + d
        bend = (F(3) * a * kept + F(2) * b) * kept + c
        t = min(max(kept - slope / max(bend, floor), kept - F(1e-5)), kept + F(1e-5))
        own[NEAREST * AREA + q] = min(max(t, F(0)), F(1))
