"""Evaluate, measure and cut quadratic Bezier curves B(t) = (1-t)^2 P0 + 2 t (1-t) P1 + t^2 P2, t in [0, 1]."""

from dataclasses import replace
from typing import TypeVar

import numpy as np
import torch
from torch import Tensor

from brushexp.strokes.catalogue import Strokes

NEWTON_STEPS = 9  # number of Newton steps in `closest_parameter`; only the last has a gradient
TIE_ROUNDINGS = 16  # number of rounding errors of a coordinate within which the first leg of a fold counts as nearer
VALLEY_WIDTH = 0.01  # minima closer than this in the parameter are one
MIN_SLOPE_PX2 = 1.25e-5  # square pixels: derivatives of t are limited as if no curve were shorter than 0.005 px
PIECES = 4  # pieces of a curve, each with its own quadrature, so that hairpins are accurate to a thousandth
MARGIN_PX = 2.0  # margin between a stroke and its window on each side
NODES, WEIGHTS = (np.polynomial.legendre.leggauss(5) + np.array([[1], [0]])) / (2 * PIECES)  # for the first piece
Length = TypeVar("Length", float, Tensor)  # pixels
Cubic = tuple[Tensor, Tensor, Tensor, Tensor]  # coefficients, highest first


def curve_of(strokes: Strokes) -> Tensor:
    """Compute the control points (N, 3, 2) of strokes in pixels."""
    return strokes.position[:, None] + shape_of(strokes)


def shape_of(strokes: Strokes) -> Tensor:
    """Compute the control points (N, 3, 2) in pixels relative to ``position``, exact even for distant strokes."""
    points = torch.stack([strokes.start, strokes.control, strokes.end], dim=1)
    return points * (0.5 * strokes.scale)[:, None, None]


def half_width_of(strokes: Strokes) -> Tensor:
    """Compute half the thickness (N,) of strokes in pixels."""
    return 0.5 * strokes.width * strokes.scale


def softness_of(strokes: Strokes) -> Tensor:
    """Compute the width (N,), in pixels, that each stroke adds to the renderer's own soft edge."""
    return strokes.softness * strokes.scale


def drift_of(strokes: Strokes) -> Tensor:
    """Compute the colour drifts (N, 3), limited so that the colours at both ends of a stroke stay in [0, 1]."""
    room = strokes.color.minimum(1 - strokes.color)
    return strokes.drift.clamp(-room, room)  # if both limits are 0, the colour gets no gradient from the drift


def roomy_window(pitch: Length) -> Length:
    """Return the side, in pixels, of a window that leaves room to move for strokes spaced a ``pitch`` apart.

    A pitch of 10 gives a side of 64 (thesis 2020). A tensor of pitches gives a tensor of sides.
    """
    return (6.4 * pitch).clamp_min(4.0) if isinstance(pitch, Tensor) else max(6.4 * pitch, 4.0)


def strokes_along(
    curve: Tensor, thickness: Tensor | float, color: Tensor, opacity: Tensor | float,
    *, window: Tensor | float | None = None, position: Tensor | None = None,
) -> Strokes:  # fmt: skip
    """Make strokes along curves (N, 3, 2) in pixels; the strokes have the curves' precision.

    Args:
        curve: start, control and end point of each stroke.
        thickness: thickness in pixels, either one for all strokes or (N,).
        color: colours (N, 3), clamped to [0, 1].
        opacity: opacity, either one for all strokes or (N,).
        window: side, in pixels, of the window in which a stroke can move (see `roomy_window`); None for a tight fit.
        position: centres (N, 2) of the windows, to which the curves are relative; None to centre them on the curves.
    """

    def each(value: Tensor | float) -> Tensor:
        return torch.as_tensor(value, dtype=curve.dtype, device=curve.device).expand(len(curve)).clone()

    low, high = curve.amin(1), curve.amax(1)
    if position is None:
        position = (low + high) / 2
        curve = curve - position[:, None]
    scale = (high - low).amax(1) + thickness + MARGIN_PX if window is None else window
    start, control, end = (curve / (0.5 * each(scale))[:, None, None]).unbind(1)
    return Strokes(
        position, each(scale), start, control, end, each(thickness / scale), color.clamp(0, 1), each(opacity)
    )


def truncate(strokes: Strokes, share: Tensor) -> Strokes:
    """Cut strokes off at parameters ``share`` (n,) of their curves (de Casteljau); the parts before stay the same."""
    t, rest, drift = share[:, None], 1 - share[:, None], drift_of(strokes)
    first, second = rest * strokes.start + t * strokes.control, rest * strokes.control + t * strokes.end
    growth = 1 - (1 - share) * strokes.widening  # thickness in the middle of the part, relative to the whole
    widening = share * strokes.widening / growth.clamp_min(torch.finfo(growth.dtype).tiny)
    paint = {"width": growth * strokes.width, "color": strokes.color - rest * drift, "drift": t * drift}
    return replace(strokes, control=first, end=rest * first + t * second, widening=widening, **paint)


def point_at(curve: Tensor, t: Tensor) -> Tensor:
    """Compute the points (..., 2) at parameters t (...) of curves (..., 3, 2)."""
    weights = torch.stack([(1 - t) ** 2, 2 * t * (1 - t), t**2], dim=-1)
    return (weights[..., None] * curve).sum(-2)


def closest_parameter(curve: Tensor, points: Tensor) -> Tensor:
    """Find the parameter t (...) in [0, 1] at which each curve (..., 3, 2) is nearest to ``points`` (..., 2).

    The distance has at most two minima, one on each side of the inflection of `distance_cubic`. For each minimum, the
    best of a few samples is refined with Newton's method and bisection. The derivative of t follows from the implicit
    function theorem; it is 0 where t is clamped to an end, and `MIN_SLOPE_PX2` limits it.
    """
    cubic = distance_cubic(curve, points)
    with torch.no_grad():
        n = _samples_for(curve)
        first, second = (_refine(cubic, start, n) for start in _nearest_samples(cubic, n))
        nearness = [(point_at(curve, t) - points).norm(dim=-1) for t in (first, second)]
        tie = TIE_ROUNDINGS * torch.finfo(curve.dtype).eps * curve.abs().amax((-1, -2))
        tie = tie * ((second - first) > VALLEY_WIDTH)  # of two points near the same minimum, only one is the nearest
        t = torch.where(nearness[1] < nearness[0] - tie, second, first)
        bend = cubic_at(cubic, t)[1].clamp_min(_floor(cubic)).clamp_min(MIN_SLOPE_PX2)
    slope, _ = cubic_at(cubic, t)
    return (t - slope / bend).clamp(0, 1)


def _refine(cubic: Cubic, t: Tensor, n: int) -> Tensor:
    """Find the zero of a cubic within one sample interval, 1 / ``n``, of ``t``, or else one end of that range."""
    low, high = (t - 1 / n).clamp_min(0), (t + 1 / n).clamp_max(1)
    for _ in range(NEWTON_STEPS - 1):
        slope, bend = cubic_at(cubic, t)
        low, high = torch.where(slope < 0, t, low), torch.where(slope > 0, t, high)
        newton = t - slope / bend.clamp_min(_floor(cubic))
        t = torch.where((low <= newton) & (newton <= high), newton, 0.5 * (low + high))
    return t


def distance_cubic(curve: Tensor, points: Tensor) -> Cubic:
    """Compute the cubic f(t) = (B(t) - p) . B'(t) / 2, whose zeros are the critical points of |B(t) - p|."""
    start, control, end = curve.unbind(-2)
    bend, forward, away = start - 2 * control + end, control - start, start - points
    return (
        (bend * bend).sum(-1),
        3 * (bend * forward).sum(-1),
        2 * (forward * forward).sum(-1) + (bend * away).sum(-1),
        (forward * away).sum(-1),
    )


def cubic_at(cubic: Cubic, t: Tensor) -> tuple[Tensor, Tensor]:
    """Evaluate a cubic and its derivative at t."""
    a, b, c, d = cubic
    return ((a * t + b) * t + c) * t + d, (3 * a * t + 2 * b) * t + c


def _samples_for(curve: Tensor) -> int:
    """Return how many sample intervals Newton's method needs to find the right minimum of every curve."""
    start, control, end = curve.unbind(-2)
    bend, chord = (start - 2 * control + end).square().sum(-1), (end - start).square().sum(-1)
    gentle, bent = bool((bend <= 0.16 * chord).all()), bool((bend <= chord).all())
    return 4 if gentle else 16 if bent else 64


def _nearest_samples(cubic: Cubic, n: int) -> tuple[Tensor, Tensor]:
    """Find the two samples of t nearest to the point, before and after the inflection of the distance's cubic."""
    a, b, c, d = cubic
    inflection = -b / (3 * a).clamp_min(torch.finfo(a.dtype).tiny)
    nearest = []
    for after in (False, True):
        best_t, best = torch.zeros_like(b), torch.full_like(b, torch.inf)
        for t in torch.linspace(0, 1, n + 1).tolist():
            away = (((a * t / 4 + b / 3) * t + c / 2) * t + d) * t  # a quarter of |B(t) - p|^2 - |P0 - p|^2
            away = away.where((inflection < t) == after, torch.inf)
            best_t, best = torch.where(away < best, t, best_t), torch.minimum(away, best)
        nearest.append(best_t)
    return nearest[0], nearest[1]


def _floor(cubic: Cubic) -> Tensor:
    """Compute a lower bound for the divisor in Newton's method: tiny compared with the curve's size, but never 0."""
    a, b, c, _ = cubic
    return 1e-6 * (a + b.abs() + c.abs()) + torch.finfo(a.dtype).tiny


def length_of(curve: Tensor) -> Tensor:
    """Compute arc lengths (...) of curves (..., 3, 2) by Gauss-Legendre quadrature, within 0.2 % even for hairpins."""
    nodes, weights = curve.new_tensor(NODES), curve.new_tensor(WEIGHTS).repeat(PIECES)
    nodes = (nodes + torch.arange(PIECES).to(nodes)[:, None] / PIECES).flatten()
    start, control, end = curve.unbind(-2)
    velocity = 2 * ((1 - nodes) * (control - start)[..., None] + nodes * (end - control)[..., None])  # (..., 2, nodes)
    speed = (velocity.square().sum(-2) + torch.finfo(curve.dtype).tiny).sqrt()
    return (speed * weights).sum(-1)
