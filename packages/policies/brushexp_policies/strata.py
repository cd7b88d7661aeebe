"""Grow a painting in strata: few large strokes, then again and again as many more of half the size on top."""

from dataclasses import dataclass, replace
from typing import Annotated

from torch import Tensor

from brushexp.contracts import at_least, between, register
from brushexp.contracts.families import DensificationState
from brushexp.contracts.strokes import Strokes
from brushexp_policies.traced import Traced


@register("density", "strata")
@dataclass(kw_only=True)
class Strata(Traced):
    """Start with few large strokes and double their number in each round, by traced ones that fit the new number.

    New strokes lie on top; ``order.until=0`` keeps that order from the first step.

    Source: Vector Scaffolding (2026), which doubles closed curves in strata. Differs from it: new strokes are traced
    through the error, and the learning rate is that of the optimiser.

    Args:
        start: share of the strokes to begin with; a sixteenth is doubled four times.
        rounds: times at which strokes are added, with 8 steps at least between them.
        until: share of the steps after which the strokes stay.
        moved: share of the strokes that each round may lay elsewhere, 0 to 0.5.
        price: least gain of a stroke that is laid elsewhere, over what it was worth; below 1, since steps improve it.
        tolerance: error (root mean square over a pixel, 0 to 1) that no stroke is worth.
        surplus: 0, as the number only grows.
    """

    start: Annotated[float, between(1e-3, 1)] = 1 / 16
    rounds: Annotated[int, at_least(1)] = 4
    until: Annotated[float, between(0, 1)] = 0.6
    moved: Annotated[float, between(0, 0.5)] = 0.0
    surplus: Annotated[float, between(0, 0)] = 0.0

    def replaced(self, state: DensificationState, missing: int, weakest: Tensor) -> tuple[Strokes, int]:
        return super().replaced(replace(state, budget=len(state.strokes) + missing), missing, weakest)

    def _goal(self, current: int, rounds: int, budget: int) -> int:
        first = max(1, self._first)
        return round(first * (budget / first) ** (current / rounds))
