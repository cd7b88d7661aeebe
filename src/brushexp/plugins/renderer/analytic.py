"""The closed-form stroke: needs no training and is drawn by the compiled kernels."""

from torch import Tensor

from brushexp.compositing.profile import Profile
from brushexp.errors import UserError
from brushexp.plugins.renderer.base import Renderer
from brushexp.registry import register
from brushexp.strokes.bezier import curve_of, half_width_of
from brushexp.strokes.catalogue import Strokes


@register("renderer", "analytic")
class Analytic(Renderer):
    """Quadratic Bezier stroke of one colour with round ends and a soft edge.

    Args:
        soft: width of the edge in pixels of the picture, > 0; wider gives smoother gradients and a softer picture.
        taper: how much thinner the two ends are than the middle, 0 (not at all) to 1 (pointed).
    """

    def __init__(self, *, soft: float = 2.0, taper: float = 0.0) -> None:
        super().__init__()
        if not 0.1 <= soft <= 100:
            raise UserError(f"renderer.soft={soft:g} is not a width of 0.1 to 100 pixels; try renderer.soft=2")
        if not 0 <= taper <= 1:
            raise UserError(f"renderer.taper={taper:g} is outside 0 to 1; try renderer.taper=0.5")
        self.soft = soft
        self.taper = taper

    def forward(self, strokes: Strokes, number: Tensor | None = None) -> Profile:
        return Profile(curve_of(strokes), half_width_of(strokes), strokes.color, strokes.opacity, self.soft, self.taper)
