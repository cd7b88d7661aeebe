"""Render strokes from a closed formula, with compiled kernels and without training."""

from typing import Annotated

from brushexp.bounds import between
from brushexp.compositing.layers import SOFT_EDGE
from brushexp.compositing.profile import Profile
from brushexp.plugins.renderer.base import Renderer
from brushexp.registry import register
from brushexp.strokes.bezier import curve_of, drift_of, half_width_of, softness_of
from brushexp.strokes.catalogue import Strokes


@register("renderer", "analytic")
class Analytic(Renderer):
    """Quadratic Bezier stroke with round ends and a soft edge.

    It supports the stroke fields ``softness``, ``widening`` and ``drift``, which are optimised if they have units in
    ``optimizer.units``, as with ``look=plain``.

    Args:
        soft: width of the edge in pixels of the picture, added to each stroke's own softness; wider edges give smoother
            gradients and a softer picture.
        taper: thinning of the two ends relative to the middle, 0 (none) to 1 (pointed).
    """

    cost, weights, strokes = "1", "none", "all"

    def __init__(
        self, *, soft: Annotated[float, between(0.1, 100)] = 2.0, taper: Annotated[float, between(0, 1)] = 0.0
    ) -> None:
        super().__init__()
        self.soft, self.edge = soft, max(SOFT_EDGE, soft / 2)
        self.taper = taper

    def forward(self, strokes: Strokes) -> Profile:
        half, softness = half_width_of(strokes), softness_of(strokes)
        numbers = strokes.color, strokes.opacity, self.soft, self.taper, softness, strokes.widening, drift_of(strokes)
        return Profile(curve_of(strokes), half, *numbers)
