"""The strokes of the initialiser, no more and no fewer."""

from brushexp.plugins.density.base import Density, Revision, Survey
from brushexp.registry import register


@register("density", "fixed")
class Fixed(Density):
    """Keep the strokes that the initialiser made."""

    def __init__(self) -> None: ...

    def revise(self, survey: Survey) -> Revision | None:
        return None
