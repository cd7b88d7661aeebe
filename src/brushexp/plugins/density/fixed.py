"""Keep a constant set of strokes."""

from brushexp.plugins.density.base import DensificationState, DensificationUpdate, Density
from brushexp.registry import register


@register("density", "fixed")
class Fixed(Density):
    """Keeps the strokes of the initialiser."""

    def due(self, step: int, steps: int) -> bool:
        return False

    def revise(self, state: DensificationState) -> DensificationUpdate | None:
        return None
