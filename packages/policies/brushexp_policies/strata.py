"""Grow a painting in strata: start with a few large strokes, and repeatedly double their number with smaller ones."""

from dataclasses import dataclass, replace
from typing import Annotated

from torch import Tensor

from brushexp.contracts import at_least, between, register
from brushexp.contracts.families import DensificationState
from brushexp.contracts.members import Traced
from brushexp.contracts.strokes import Strokes


@register("density", "strata")
@dataclass(kw_only=True)
class Strata(Traced):
    """Start with a few large strokes, and double their number in each round with traced strokes of a suitable size.

    New strokes are placed on top; ``order.until=0`` preserves this order from the first step.

    Source: Vector Scaffolding (2026), which doubles closed curves in strata. Unlike in the source, new strokes are
    traced through the error, and the learning rate is that of the optimiser.

    Args:
        start: initial fraction of the strokes; a sixteenth is doubled four times.
        rounds: number of rounds that add strokes, at least 8 steps apart.
        until: fraction of the steps after which no strokes are added or removed.
        moved: fraction of the strokes that each round may move elsewhere, 0 to 0.5.
        price: minimum ratio of a new stroke's gain to the importance of the stroke that it replaces; below 1, because
            further steps improve the new stroke.
        tolerance: error (root mean square over a pixel, 0 to 1) below which no stroke is added.
        surplus: number of temporary extra strokes; must be 0, because the number of strokes only grows.
    """

    start: Annotated[float, between(1e-3, 1)] = 1 / 16
    rounds: Annotated[int, at_least(1)] = 4
    until: Annotated[float, between(0, 1)] = 0.6
    moved: Annotated[float, between(0, 0.5)] = 0.0
    surplus: Annotated[float, between(0, 0)] = 0.0

    def replacements(self, state: DensificationState, missing: int, weakest: Tensor) -> tuple[Strokes, int]:
        return super().replacements(replace(state, budget=len(state.strokes) + missing), missing, weakest)

    def _goal(self, current: int, rounds: int, budget: int) -> int:
        first = max(1, self._first)
        return round(first * (budget / first) ** (current / rounds))
