"""Density plugin in a single file: ``density=unfaint``."""

from typing import Annotated

from brushexp.contracts import between, register
from brushexp.contracts.families import DensificationState, DensificationUpdate, Density
from brushexp.contracts.strokes import Strokes


@register("density", "unfaint")
class Unfaint(Density):
    """Removes faint strokes once, after half of the steps, and does not add strokes.

    Args:
        opacity: opacity below which a stroke is removed.
    """

    def __init__(self, *, opacity: Annotated[float, between(0, 1)] = 0.1) -> None:
        self.opacity = opacity

    def due(self, step: int, steps: int) -> bool:
        return step == steps // 2

    def revise(self, state: DensificationState) -> DensificationUpdate:
        return DensificationUpdate(keep=state.strokes.opacity >= self.opacity, new=Strokes.none())
