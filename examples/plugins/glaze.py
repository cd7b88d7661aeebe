"""Renderer plugin in a single file: ``renderer=glaze``."""

from typing import Annotated

from brushexp.contracts import above, between, register
from brushexp.contracts.families import Renderer
from brushexp.contracts.layers import Profile
from brushexp.contracts.strokes import Strokes, curve_of, half_width_of


@register("renderer", "glaze")
class Glaze(Renderer):
    """Thin paint: the paint below shows through every stroke.

    Args:
        cover: largest fraction of the paint below that a stroke hides.
        soft: width of the soft edge in pixels.
    """

    def __init__(
        self, *, cover: Annotated[float, between(0.05, 1)] = 0.5, soft: Annotated[float, above(0, 100)] = 2.0
    ) -> None:
        super().__init__()
        self.cover = cover
        self.soft = soft

    def forward(self, strokes: Strokes) -> Profile:
        opacity = self.cover * strokes.opacity
        return Profile(curve_of(strokes), half_width_of(strokes), strokes.color, opacity, self.soft, 0.0)
