"""Penalise the curvature of strokes."""

from torch import Tensor

from brushexp.plugins.loss.base import Loss, PaintedView
from brushexp.registry import register
from brushexp.strokes.bezier import shape_of
from brushexp.strokes.measures import curvature_of
from brushexp.system.precision import at_least_single


@register("loss", "curvature")
class Curvature(Loss):
    """Mean total curvature of the strokes: the turn from end to end in radians; 0 if all are straight.

    Source: Kotovenko et al., 2021, arXiv:2103.17185, who penalise |(s - c) + (e - c)| / |e - s|. Differs: this is the
    total curvature that `task=analyse` reports (`strokes.measures.curvature_of`), twice the arc tangent of the source's
    for symmetric strokes; it is at most pi, and ignores a control point off the middle of a straight line.

    Args:
        weight: factor in the sum of losses; the source's 4 is for other units. On a portrait ``mse`` alone left a mean
            of 1.26 rad, with the default of this loss 0.48 at a cost of 0.1 dB; 0.0005 left 0.25 (0.3 dB).
    """

    weight = 0.0002
    cost = "0.5 x mse"
    looks_at = "strokes"

    def forward(self, view: PaintedView) -> Tensor:
        shape = shape_of(view.strokes.map(at_least_single))
        return curvature_of(shape).sum() / max(len(shape), 1)
