"""Penalise the curvature of strokes."""

from torch import Tensor

from brushexp.plugins.loss.base import Loss, PaintedView
from brushexp.registry import register
from brushexp.strokes.bezier import shape_of
from brushexp.strokes.measures import curvature_of
from brushexp.system.precision import at_least_single


@register("loss", "curvature")
class Curvature(Loss):
    """Mean total curvature of the strokes, the turn from start to end in radians; 0 if all strokes are straight.

    Source: Kotovenko et al., 2021, arXiv:2103.17185, who penalise |(s - c) + (e - c)| / |e - s|. Unlike the source,
    this loss uses the total curvature that `task=analyse` reports (`strokes.measures.curvature_of`). For symmetric
    strokes, it is twice the arc tangent of the source's quantity; it is at most pi, and it does not depend on where the
    control point is along a straight stroke.

    Args:
        weight: factor in the sum of losses; the source's 4 applies to other units. On a portrait, the mean was 1.26 rad
            with ``mse`` alone, 0.48 with this loss at its default weight (costing 0.1 dB), and 0.25 with a weight of
            0.0005 (0.3 dB).
    """

    weight = 0.0002
    cost = "0.5 x mse"
    looks_at = "strokes"

    def forward(self, view: PaintedView) -> Tensor:
        shape = shape_of(view.strokes.map(at_least_single))
        return curvature_of(shape).sum() / max(len(shape), 1)
