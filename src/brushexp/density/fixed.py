"""The strokes of the initialiser, no more and no fewer."""

from brushexp.density.base import Density, Revision
from brushexp.loss.base import Painting
from brushexp.registry import register


@register("density", "fixed")
class Fixed(Density):
    """Keep the strokes that the initialiser made."""

    def __init__(self) -> None: ...

    def revise(self, painting: Painting, step: int, n_steps: int) -> Revision | None:
        return None
