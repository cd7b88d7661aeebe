"""Coverage of strokes without texture, as in `brushexp.compositing.profile`, for Triton kernels."""
# mypy: allow-untyped-defs

import triton.language as tl

from brushexp.contracts.kernels import profile
from brushexp_gpu.curves import LEAST_SLOPE, clip, store_moments, sum_pixels
from brushexp_gpu.launch import inline

LEAST_BEND = tl.constexpr(float(profile.LEAST_BEND))


@inline
def _rise(x):
    z = clip(x, -0.5, 0.5)
    return z * (1.5 - 2.0 * z * z)


@inline
def _slope(x):
    """Compute one sixth of the derivative of `_rise`."""
    z = clip(x + 0.5, 0.0, 1.0)
    return z * (1.0 - z)


@inline
def _offset(t, sx, sy, fx, fy, bx, by, x, y):
    """Compute the vectors from pixels to the points on the curve at parameters ``t``."""
    return (bx * t + 2.0 * fx) * t + (sx - x), (by * t + 2.0 * fy) * t + (sy - y)


@inline
def plain_cover(t, sx, sy, fx, fy, bx, by, x, y, half, sharp, widening, taper):
    """Compute each pixel's coverage before opacity; ``half``, ``sharp`` and ``widening`` are (TILES, 1)."""
    rx, ry = _offset(t, sx, sy, fx, fy, bx, by, x, y)
    d, u = tl.sqrt(rx * rx + ry * ry), t + t - 1.0
    ht = half * (1.0 - taper * u * u) * (1.0 + widening * u)
    cover = _rise((ht + d) * sharp) + _rise((ht - d) * sharp)
    return tl.where(half > 0.0, tl.maximum(cover, 0.0), 0.0)  # rounding may give less than 0, or paint without a stroke


@inline
def plain_pull(out, ga, t, sx, sy, fx, fy, bx, by, x, y, half, opacity, sharp, widening, taper, by_color, here):
    """Write the gradient of a stroke's numbers, except opacity and colour, to ``out`` + 0 to 9.

    The inputs are the gradient ``ga`` of alpha, and ``by_color``, the part of the gradient of ``t`` that comes from the
    colour.
    """
    rx, ry = _offset(t, sx, sy, fx, fy, bx, by, x, y)
    d, u = tl.sqrt(rx * rx + ry * ry), t + t - 1.0
    thin, grown = 1.0 - taper * u * u, 1.0 + widening * u
    ht = half * thin * grown
    inner, outer = _slope((ht - d) * sharp), _slope((ht + d) * sharp)
    gh, gd = ga * (inner + outer), ga * (outer - inner) / tl.maximum(d, 1e-6)  # both slopes are equal at d = 0
    scale = 6.0 * opacity * sharp
    tl.store(out + 6, sum_pixels(scale * gh * thin * grown), here)
    tl.store(out + 8, sum_pixels(6.0 * opacity * ga * (inner * (ht - d) + outer * (ht + d))), here)
    tl.store(out + 9, sum_pixels(scale * gh * half * thin * u), here)
    gx, gy = scale * gd * rx, scale * gd * ry  # gradient of the curve's point
    # Thickness and colour depend on t, which depends on the control points.
    dx, dy = bx * t + fx, by * t + fy
    size = bx * bx + by * by + 3.0 * tl.abs(bx * fx + by * fy) + 2.0 * (fx * fx + fy * fy)
    bend = 2.0 * (dx * dx + dy * dy) + bx * rx + by * ry
    thins = 2.0 * (2.0 * taper * u * grown - widening * thin)  # derivative in t, per half-width
    gt = scale * gh * half * thins - by_color
    gt /= tl.maximum(bend, tl.maximum(size * LEAST_SLOPE + 1e-20, LEAST_BEND))
    gt = tl.where((t > 0.0) & (t < 1.0), gt, 0.0)  # clamped at an end, t does not move
    gx, gy, vx, vy = gx + gt * dx, gy + gt * dy, gt * rx, gt * ry  # gradient of half the velocity there
    ux, uy = t * gx, t * gy
    store_moments(out, gx, 2.0 * ux + vx, t * (ux + vx), gy, 2.0 * uy + vy, t * (uy + vy), here)
