"""Strokes with round ends, soft edges and possibly a colour gradient along their length, and the parts of their kernel.

By the envelope theorem, the distance to a curve depends on its control points only through the nearest point at fixed
t, so the gradient of the distance is the unit normal times the Bernstein weights. Where thickness or colour changes
along the stroke, the derivative through t is added.
"""
# mypy: allow-untyped-defs

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
import torch
from torch import Tensor

from brushexp.compat.compiled import first_of, inline
from brushexp.compositing.layers import Encode, KernelInput, Layers, TileKernel
from brushexp.compositing.nearest import LEAST_SLOPE
from brushexp.compositing.passes import of_color
from brushexp.compositing.scratch import CHANNELS, PULL_ALPHA
from brushexp.compositing.tile_lists import AREA, CENTER_X, CENTER_Y, NEAREST, F
from brushexp.strokes.bezier import closest_parameter, point_at

LEAST_BEND = F(1.25e-5)  # square pixels: as in `strokes.bezier`
SHARP, WIDENING = 8, 9  # columns after the control points, the half width and the opacity
COLOR = 10  # columns after the control points, half width and opacity
DRIFTS = False  # column of the first channel; their drift follows the last one if they drift
DISTANCE, COVER, ROWS = 2, 3, 4  # whether colours change along strokes, a constant of the kernel


@dataclass(frozen=True)
class Profile(Layers):
    """Strokes with round ends and soft edges, each in one colour or a linear gradient of colour along the stroke.

    alpha = opacity * C(d), where d is the distance to the curve and C(d) = S(h + d) + S(h - d) - 1, with a smooth step
    S of width ``soft`` + ``softness``: a box of half width h smoothed by S, so that a line thinner than its soft edge
    fades instead of disappearing. At the nearest parameter t, h = half_width * (1 - taper * u^2) * (1 + widening * u)
    with u = 2t - 1, and the colour is color + drift * u.
    """

    per_stroke = ("curve", "half_width", "color", "opacity", "softness", "widening", "drift")

    curve: Tensor
    half_width: Tensor  # (N,) pixels
    color: Tensor
    opacity: Tensor  # (N,)
    soft: float  # smallest width of an edge, pixels, > 0
    taper: float  # how much thinner both ends are, 0 (no thinner) to 1 (pointed)
    softness: Tensor = None  # type: ignore[assignment]  # (N,) by how many pixels edges are wider; 0 if not given
    widening: Tensor = None  # type: ignore[assignment]  # (N,) growth from the middle to the end, -1 to 1; 0 if not given
    drift: Tensor = None  # type: ignore[assignment]  # (N, C) colour at the end less that in the middle; 0 if not given

    def __post_init__(self) -> None:
        for name, like in (("softness", self.half_width), ("widening", self.half_width), ("drift", self.color)):
            if getattr(self, name) is None:
                object.__setattr__(self, name, torch.zeros_like(like))

    @property
    def reach(self) -> Tensor:  # type: ignore[override]
        return self.half_width * (1 + self.widening.abs()) + 0.5 * (self.soft + self.softness)

    @property
    def drifts(self) -> bool:
        return self.drift.requires_grad or bool(self.drift.any())

    def sample(self, index: Tensor, points: Tensor) -> tuple[Tensor, Tensor]:
        curve = self.curve[index][:, :, None]  # (T, K, 1, 3, 2)
        points = points[:, None]  # (T, 1, P, 2)
        t = closest_parameter(curve, points)  # (T, K, P)
        if not (self.taper or self.widening.any() or self.drifts):
            t = t.detach()  # t minimises the distance, so its derivative vanishes to first order
        offset = (point_at(curve, t) - points).square().sum(-1)
        distance = (offset + 1e-12 * (offset == 0)).sqrt()  # the slope at 0 is 0, not 0/0
        half, soft = self.half_width[index][..., None], self.soft + self.softness[index][..., None]
        u = 2 * t - 1
        half = half * (1 - self.taper * u**2) * (1 + self.widening[index][..., None] * u)
        coverage = smooth_rise((half + distance) / soft) + smooth_rise((half - distance) / soft)
        coverage = coverage.clamp_min(0)  # rounding may produce less
        color = self.color[index][:, :, None]
        if self.drifts:
            color = color + self.drift[index][:, :, None] * u[..., None]
        return self.opacity[index][..., None] * coverage, color

    def encoded(self, encode: Encode) -> Self:
        first, last = encode(self.color - self.drift), encode(self.color + self.drift)
        return replace(self, color=(first + last) / 2, drift=(last - first) / 2)

    def compiled(self) -> KernelInput:
        numbers = self.half_width, self.opacity, 1 / (self.soft + self.softness), self.widening
        strokes = [self.curve.flatten(1), torch.stack(numbers, dim=1), self.color]
        kernel, more = (DRIFTING, [self.drift]) if self.drifts else (KERNEL, [])
        return KernelInput(kernel, torch.cat(strokes + more, dim=1), (F(self.taper),))


def smooth_rise(x: Tensor) -> Tensor:
    """Compute a cubic step from -1/2 (x <= -1/2) to 1/2 (x >= 1/2); it is exactly odd, so f(x) + f(-x) = 0."""
    z = x.clamp(-0.5, 0.5)
    return z * (1.5 - 2 * z * z)


@inline
def _rise(x):
    z = min(max(x, F(-0.5)), F(0.5))
    return z * (F(1.5) - F(2) * z * z)


@inline
def _slope(x):
    """Compute one sixth of the derivative of `_rise`."""
    z = min(max(x + F(0.5), F(0)), F(1))
    return z * (F(1) - z)


@inline
def _is_wide(p, i, taper):
    """Check whether a stroke is nowhere thinner than its soft edge, so that only one side affects each point."""
    return taper == F(0) and p[i, 6] * (F(1) - abs(p[i, WIDENING])) * p[i, SHARP] >= F(0.5)


@inline
def _shape(taper, widening, u):
    """Compute the thickness at u = 2t - 1, relative to the thickness at the middle."""
    return (F(1) - taper * u * u) * (F(1) + widening * u)


@inline
def _growth(taper, widening, u):
    """Compute the derivative of `_shape` with respect to t."""
    return F(2) * (widening * (F(1) - taper * u * u) - F(2) * taper * u * (F(1) + widening * u))


@inline
def _cover(p, i, data, ox, oy, own, temporary):
    if _is_wide(p, i, data[0]):
        _cover_pixels(p, i, ox, oy, data[0], own, True)
    else:
        _cover_pixels(p, i, ox, oy, data[0], own, False)
    return True


@inline
def _cover_pixels(p, i, ox, oy, taper, own, wide):
    sharp, widening = p[i, SHARP], p[i, WIDENING]
    sx, sy, cx, cy, ex, ey = p[i, 0] - ox, p[i, 1] - oy, p[i, 2] - ox, p[i, 3] - oy, p[i, 4] - ox, p[i, 5] - oy
    bx, by, fx, fy = sx - F(2) * cx + ex, sy - F(2) * cy + ey, F(2) * (cx - sx), F(2) * (cy - sy)
    h = p[i, 6]
    there = F(1) if h > F(0) else F(0)
    for q in range(AREA):
        t = own[NEAREST * AREA + q]
        rx, ry = (bx * t + fx) * t + (sx - CENTER_X[q]), (by * t + fy) * t + (sy - CENTER_Y[q])
        d, u = np.sqrt(rx * rx + ry * ry), t + t - F(1)
        own[DISTANCE * AREA + q] = d
        if wide:
            own[COVER * AREA + q] = F(0.5) + _rise((h + h * widening * u - d) * sharp)
        else:
            ht = h * _shape(taper, widening, u)
            cover = _rise((ht + d) * sharp) + _rise((ht - d) * sharp)
            own[COVER * AREA + q] = max(cover, F(0)) * there  # rounding may go below 0; zero width covers nothing


@inline
def _tint(p, i):
    if DRIFTS:
        return p[i, 7], first_of(p[i, COLOR:], CHANNELS), first_of(p[i, COLOR + CHANNELS :], CHANNELS)
    return p[i, 7], first_of(p[i, COLOR:], CHANNELS), first_of(p[i, COLOR:], CHANNELS)


@inline
def _shade(look, own, q):
    t = own[NEAREST * AREA + q] if DRIFTS else F(0.5)
    return look[0] * own[COVER * AREA + q], t + t - F(1)


@inline
def _tone(look, seen, own, q, c):
    return seen[0] * (look[1][c] + seen[1] * look[2][c] if DRIFTS else look[1][c])


@inline
def _pull(p, i, data, ox, oy, own, temporary, buf, out):
    if _is_wide(p, i, data[0]):
        _pull_curve(p, i, ox, oy, data[0], own, temporary, buf, out, True)
    else:
        _pull_curve(p, i, ox, oy, data[0], own, temporary, buf, out, False)
    for c in range(CHANNELS):
        total, moment = F(0), F(0)
        for q in range(AREA):
            gc = own[COVER * AREA + q] * of_color(own, buf, q, c)
            total += gc
            if DRIFTS:
                moment += gc * own[NEAREST * AREA + q]
        out[COLOR + c] = p[i, 7] * total
        if DRIFTS:
            out[COLOR + CHANNELS + c] = p[i, 7] * (moment + moment - total)
    if DRIFTS or data[0] > F(0) or p[i, WIDENING] != F(0):
        _add_change(p, i, ox, oy, data[0], own, temporary, out)


@inline
def _pull_curve(p, i, ox, oy, taper, own, of_t, buf, out, wide):
    """Compute the gradients of half width, opacity, sharpness, widening and, at fixed t, the control points."""
    sharp, widening = p[i, SHARP], p[i, WIDENING]
    sx, sy, cx, cy, ex, ey = p[i, 0] - ox, p[i, 1] - oy, p[i, 2] - ox, p[i, 3] - oy, p[i, 4] - ox, p[i, 5] - oy
    bx, by, fx, fy = sx - F(2) * cx + ex, sy - F(2) * cy + ey, F(2) * (cx - sx), F(2) * (cy - sy)
    h, scale, (_, color, drift) = p[i, 6], F(6) * p[i, 7] * sharp, _tint(p, i)
    x0, x1, x2, y0, y1, y2 = F(0), F(0), F(0), F(0), F(0), F(0)
    g6, g7, g8, g9 = F(0), F(0), F(0), F(0)
    for q in range(AREA):
        t, d = own[NEAREST * AREA + q], own[DISTANCE * AREA + q]
        u = t + t - F(1)
        ga = buf[PULL_ALPHA * AREA + q] + _of_all(color, own, buf, q)
        gt = F(0)
        if DRIFTS:
            gu = _of_all(drift, own, buf, q)
            ga += u * gu
            gt = F(2) * p[i, 7] * own[COVER * AREA + q] * gu
        g7 += own[COVER * AREA + q] * ga
        if wide:
            ht = h + h * widening * u
            gh = ga * _slope((ht - d) * sharp)
            gd = -gh
            g6 += gh * (F(1) + widening * u)
            g8 += gh * (ht - d)
            g9 += gh * u
        else:
            ht = h * _shape(taper, widening, u)
            inner, outer = _slope((ht - d) * sharp), _slope((ht + d) * sharp)
            gh, gd = ga * (inner + outer), ga * (outer - inner)  # both slopes agree at d = 0
            g6 += gh * _shape(taper, widening, u)
            g8 += ga * (inner * (ht - d) + outer * (ht + d))
            g9 += gh * (F(1) - taper * u * u) * u
        of_t[q] = gt + scale * gh * p[i, 6] * _growth(taper, widening, u)
        gd /= max(d, F(1e-6))
        px, py = gd * ((bx * t + fx) * t + (sx - CENTER_X[q])), gd * ((by * t + fy) * t + (sy - CENTER_Y[q]))
        x0 += px  # moments, which give the Bernstein weights
        x1 += px * t
        x2 += px * t * t
        y0 += py
        y1 += py * t
        y2 += py * t * t
    out[0], out[2], out[4] = scale * (x0 - F(2) * x1 + x2), scale * F(2) * (x1 - x2), scale * x2
    out[1], out[3], out[5] = scale * (y0 - F(2) * y1 + y2), scale * F(2) * (y1 - y2), scale * y2
    out[6], out[7], out[SHARP], out[WIDENING] = scale * g6, g7, F(6) * p[i, 7] * g8, scale * h * g9


@inline
def _of_all(color, own, buf, q):
    """Compute the contribution of the colour channels to the derivative with respect to alpha."""
    total = F(0)
    for c in range(CHANNELS):
        total += color[c] * of_color(own, buf, q, c)
    return total


@inline
def _add_change(p, i, ox, oy, taper, own, of_t, out):
    """Add to the curve's gradient the effect that the control points have on thickness and colour by changing t."""
    sx, sy, cx, cy, ex, ey = p[i, 0] - ox, p[i, 1] - oy, p[i, 2] - ox, p[i, 3] - oy, p[i, 4] - ox, p[i, 5] - oy
    bx, by, fx, fy = sx - F(2) * cx + ex, sy - F(2) * cy + ey, cx - sx, cy - sy
    size = bx * bx + by * by + F(3) * abs(bx * fx + by * fy) + F(2) * (fx * fx + fy * fy)
    floor = LEAST_SLOPE * size + F(1e-20)
    g0, g1, g2, g3, g4, g5 = F(0), F(0), F(0), F(0), F(0), F(0)
    for q in range(AREA):
        t = own[NEAREST * AREA + q]
        v = F(1) - t
        u = t - v
        b0, b1, b2 = v * v, F(2) * t * v, t * t
        rx = b0 * sx + b1 * cx + b2 * ex - CENTER_X[q]
        ry = b0 * sy + b1 * cy + b2 * ey - CENTER_Y[q]
        dx, dy = bx * t + fx, by * t + fy
        bend = max(F(2) * (dx * dx + dy * dy) + bx * rx + by * ry, floor, LEAST_BEND)
        gt = -of_t[q] / bend
        gt = gt if t > F(0) else F(0)  # at an end, t is fixed
        gt = gt if t < F(1) else F(0)
        g0 += gt * (b0 * dx - v * rx)
        g1 += gt * (b0 * dy - v * ry)
        g2 += gt * (b1 * dx - u * rx)
        g3 += gt * (b1 * dy - u * ry)
        g4 += gt * (b2 * dx + t * rx)
        g5 += gt * (b2 * dy + t * ry)
    out[0] += g0
    out[1] += g1
    out[2] += g2
    out[3] += g3
    out[4] += g4
    out[5] += g5


KERNEL = TileKernel(rows=ROWS, cover=_cover, tint=_tint, shade=_shade, tone=_tone, pull=_pull)
DRIFTING = TileKernel(rows=ROWS, cover=_cover, tint=_tint, shade=_shade, tone=_tone, pull=_pull, DRIFTS=True)
