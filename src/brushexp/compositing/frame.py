"""Compute the coordinates of points relative to a stroke: along its curve, beyond its ends, and across it."""

import torch
from torch import Tensor

from brushexp.strokes.bezier import closest_parameter, point_at

SLOWEST = 1e-3  # a curve slower than this fraction of its size has no direction of its own (a cusp, a point)
SLOWEST_PIXELS = 0.005  # nor does any curve slower than this
LEAST_SQUARE = 0.1  # derivatives are limited as if the curve were nowhere slower than about this fraction of its size
SHORTEST_SQUARED = 1 / 32  # and no shorter than about a quarter of its half width (squared)


def stroke_frame(curve: Tensor, points: Tensor, half_width: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Compute coordinates (...) of ``points`` (..., 2) relative to strokes with control points (..., 3, 2).

    ``t`` is the parameter in [0, 1] of the nearest point of the curve. ``along`` (pixels) is 0 beside the curve,
    negative before its start and positive beyond its end, measured along the tangent there. ``across`` (pixels) is
    positive for points clockwise of the stroke's direction on a canvas whose y axis points down. along^2 + across^2 is
    always the squared distance, so no point appears nearer than it is.

    Where the velocity of the curve is zero (at the tip of a fold, or if the curve is a single point), there is no
    tangent. It is replaced by a direction perpendicular to the offset, chosen so that the point is on the outer side of
    the curve.

    Derivatives: the gradient of ``across`` is the unit normal (envelope theorem), the gradient of ``t`` follows from
    the implicit function theorem, and beyond the ends the rotation of the tangent is taken into account. The last two
    grow without bound where a curve is short or slow or bends around the point, so they are limited there
    (``LEAST_SQUARE``, ``SHORTEST_SQUARED``) to keep strokes stable.
    """
    start, control, end = curve.unbind(-2)
    bend, forward = start - 2 * control + end, control - start
    with torch.no_grad():
        nearest = closest_parameter(curve, points)
    offset = points - point_at(curve, nearest)
    velocity = forward + nearest[..., None] * bend  # half of B'
    with torch.no_grad():
        size = forward.square().sum(-1) + (forward + bend).square().sum(-1)
        speed = velocity.square().sum(-1)
        moves = speed > SLOWEST**2 * size + SLOWEST_PIXELS**2
        outer = torch.where(_cross(forward, bend) > 0, -1.0, 1.0).to(curve.dtype)
        square = outer[..., None] * torch.stack([offset[..., 1], -offset[..., 0]], dim=-1)
        tangent = torch.where(moves[..., None], velocity, square)
        tangent = tangent / tangent.square().sum(-1, keepdim=True).clamp_min(1e-30).sqrt()
        normal = torch.stack([-tangent[..., 1], tangent[..., 0]], dim=-1)
        at_end = (nearest <= 0) | (nearest >= 1)
        turns = (moves & at_end) / speed.clamp_min(LEAST_SQUARE * size + 1e-30).sqrt()
        steep = 2 * speed - (offset * bend).sum(-1)
        slides = ~at_end / steep.clamp_min(LEAST_SQUARE * size + SHORTEST_SQUARED * half_width.square())
    turn = (normal * (velocity - velocity.detach())).sum(-1) * turns  # 0, but with a derivative
    tangent = tangent + normal * turn[..., None]
    slope = (offset * velocity).sum(-1)
    t = nearest + (slope - slope.detach()) * slides
    along = torch.where(at_end, (tangent * offset).sum(-1), 0.0)
    return t, along, _cross(tangent, offset)


def _cross(a: Tensor, b: Tensor) -> Tensor:
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
