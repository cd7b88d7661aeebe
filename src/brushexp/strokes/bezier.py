"""Mathematics of the quadratic Bezier curve B(t) = (1-t)^2 P0 + 2 t (1-t) P1 + t^2 P2, t in [0, 1]."""

import torch
from torch import Tensor

from brushexp.strokes.catalogue import Strokes

NEWTON_STEPS = 5  # in `closest_parameter`, the last one with a gradient


def curve_of(strokes: Strokes) -> Tensor:
    """Control points (N, 3, 2) in pixels."""
    points = torch.stack([strokes.start, strokes.control, strokes.end], dim=1)
    return strokes.position[:, None] + points * (0.5 * strokes.scale)[:, None, None]


def half_width_of(strokes: Strokes) -> Tensor:
    """Half of the thickness (N,) in pixels."""
    return 0.5 * strokes.width * strokes.scale


def bernstein(t: Tensor) -> Tensor:
    """Weights (..., 3) of the three control points at parameter t (...)."""
    return torch.stack([(1 - t) ** 2, 2 * t * (1 - t), t**2], dim=-1)


def point_at(curve: Tensor, t: Tensor) -> Tensor:
    """Points (..., 2) of curves (..., 3, 2) at parameters t (...)."""
    return (bernstein(t)[..., None] * curve).sum(-2)


def closest_parameter(curve: Tensor, points: Tensor) -> Tensor:
    """Parameter t (...) in [0, 1] of the point of each curve (..., 3, 2) nearest to ``points`` (..., 2).

    The best of a few samples (65 if a curve bends as much as it is long), then Newton's method on the derivative of the
    squared distance, held between the neighbouring samples. Its derivative with respect to curve and points is that of
    the implicit function theorem, and 0 where t is held at an end.
    """
    cubic = distance_cubic(curve, points)
    with torch.no_grad():
        n = _samples_for(curve)
        t = _nearest_sample(cubic, n)
        low, high = (t - 1 / n).clamp_min(0), (t + 1 / n).clamp_max(1)
        for _ in range(NEWTON_STEPS - 1):
            slope, bend = cubic_at(cubic, t)
            t = (t - slope / bend.clamp_min(_floor(cubic))).clamp(low, high)
        bend = cubic_at(cubic, t)[1].clamp_min(_floor(cubic))
    slope, _ = cubic_at(cubic, t)
    return (t - slope / bend).clamp(0, 1)


def distance_cubic(curve: Tensor, points: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Coefficients, highest first, of f(t) = (B(t) - p) . B'(t) / 2, whose zeros are the critical points of |B - p|."""
    start, control, end = curve.unbind(-2)
    bend, forward, away = start - 2 * control + end, control - start, start - points
    return (
        (bend * bend).sum(-1),
        3 * (bend * forward).sum(-1),
        2 * (forward * forward).sum(-1) + (bend * away).sum(-1),
        (forward * away).sum(-1),
    )


def cubic_at(cubic: tuple[Tensor, Tensor, Tensor, Tensor], t: Tensor) -> tuple[Tensor, Tensor]:
    """Value and derivative of a cubic."""
    a, b, c, d = cubic
    return ((a * t + b) * t + c) * t + d, (3 * a * t + 2 * b) * t + c


def _samples_for(curve: Tensor) -> int:
    """Intervals between samples that put Newton's method into the right valley for every curve of a batch."""
    start, control, end = curve.unbind(-2)
    bend, chord = (start - 2 * control + end).square().sum(-1), (end - start).square().sum(-1)
    gentle, bent = bool((bend <= 0.16 * chord).all()), bool((bend <= chord).all())
    return 4 if gentle else 16 if bent else 64


def _nearest_sample(cubic: tuple[Tensor, Tensor, Tensor, Tensor], n: int) -> Tensor:
    a, b, c, d = cubic
    best_t, best = torch.zeros_like(c), torch.zeros_like(c)
    for t in torch.linspace(0, 1, n + 1).tolist():
        away = (((a * t / 4 + b / 3) * t + c / 2) * t + d) * t  # a quarter of |B - p|^2 - |P0 - p|^2
        best_t = torch.where(away < best, t, best_t)
        best = torch.minimum(away, best)
    return best_t


def _floor(cubic: tuple[Tensor, Tensor, Tensor, Tensor]) -> Tensor:
    """Least curvature Newton may divide by: tiny against the curve's own squared length, and never 0."""
    a, b, c, _ = cubic
    return 1e-6 * (a + b.abs() + c.abs()) + torch.finfo(a.dtype).tiny


def length_of(curve: Tensor) -> Tensor:
    """Arc length (...) of curves (..., 3, 2) by five-point Gauss-Legendre quadrature of the speed.

    Relative error below 1e-3 unless the curve turns back on itself; gradients are finite for a curve that is a point.
    """
    nodes = curve.new_tensor([0.046910077, 0.230765345, 0.5, 0.769234655, 0.953089923])
    weights = curve.new_tensor([0.118463443, 0.239314335, 0.284444444, 0.239314335, 0.118463443])
    start, control, end = curve.unbind(-2)
    velocity = 2 * ((1 - nodes) * (control - start)[..., None] + nodes * (end - control)[..., None])  # (..., 2, 5)
    speed = (velocity.square().sum(-2) + torch.finfo(curve.dtype).tiny).sqrt()
    return (speed * weights).sum(-1)
