"""Add and remove strokes in rounds; a policy decides which to add and which to replace."""

import math
from abc import abstractmethod
from dataclasses import dataclass, field
from typing import Annotated, Any

from torch import Tensor

from brushexp.bounds import at_least, between
from brushexp.plugins.density.base import DensificationState, DensificationUpdate, Density
from brushexp.strokes.catalogue import Strokes

CHANNELS = 3
MIN_SHARE = 1e-3  # smallest initial share of the strokes
STEPS_BETWEEN_ROUNDS = 8  # minimum number of steps for new strokes to settle
TOP = 0.3  # share of the rounds after which the surplus of strokes is largest


@dataclass(kw_only=True)
class Rounds(Density):
    """Starts with some of the strokes; each round removes useless strokes, adds new ones and replaces the weakest.

    A stroke is useless if its removal increases the squared error no more than an error of ``tolerance`` at a single
    pixel would. With a ``surplus``, the number of strokes temporarily exceeds the final number, and later rounds remove
    the least important strokes.
    """

    start: Annotated[float, between(MIN_SHARE, 1)] = 0.7
    rounds: Annotated[int, at_least(1)] = 12
    until: Annotated[float, between(0, 1)] = 0.75
    moved: Annotated[float, between(0, 0.5)] = 0.1
    tolerance: Annotated[float, between(0, 1)] = 0.004
    surplus: Annotated[float, between(0, 3)] = 0.0
    _round: int = field(default=0, init=False)  # number of the last round
    _first: int = field(default=0, init=False)  # initial number of strokes
    uses_importance = True

    @abstractmethod
    def replacements(self, state: DensificationState, missing: int, weakest: Tensor) -> tuple[Strokes, int]:
        """Return new strokes, and how many of the weakest strokes they replace.

        There may be up to ``missing`` more new strokes than replaced ones. ``weakest`` (M,) holds the importance of the
        strokes that may be replaced, least important first.
        """

    def is_good_enough(self, state: DensificationState) -> bool:
        """Return whether the picture is already so good that a round can be skipped."""
        return False

    def first(self, budget: int, steps: int) -> int:
        return max(1, round(self.start * budget)) if self._rounds(steps) else budget

    def idle_reason(self, steps: int) -> str:
        if self._rounds(steps):
            return ""
        if not self.until:
            return "adds and removes no strokes with density.until=0"
        least = math.ceil(STEPS_BETWEEN_ROUNDS / self.until)
        return f"adds and removes no strokes in {steps} steps; it needs steps={least} or more"

    def _rounds(self, steps: int) -> int:
        return min(self.rounds, int(self.until * steps / STEPS_BETWEEN_ROUNDS))

    def revise(self, state: DensificationState) -> DensificationUpdate | None:
        n, rounds = len(state.strokes), self._rounds(state.steps)
        self._first = self._first or n
        current = min(rounds, int(rounds * state.step / (self.until * state.steps))) if rounds else 0
        if current <= self._round or state.step >= state.steps:
            return None
        self._round = current
        if n <= state.budget and self.is_good_enough(state):
            return None
        importance = state.importance()
        keep = importance > CHANNELS * self.tolerance**2
        if n:
            keep[importance.argmax()] = True
        goal = self._goal(current, rounds, state.budget)
        ranks = importance.where(keep, math.inf).argsort(stable=True)
        spare = max(0, int(keep.sum()) - goal)
        keep[ranks[:spare]] = False
        rest = int(keep.sum())
        missing, moved = max(0, goal - rest), max(0, min(round(self.moved * n), rest - 1))
        weakest = ranks[spare : spare + moved]
        new, gone = self.replacements(state, missing, importance[weakest])
        keep[weakest[:gone]] = False
        return DensificationUpdate(keep, new) if len(new) or not keep.all() else None

    def _goal(self, current: int, rounds: int, budget: int) -> int:
        """Return the number of strokes allowed after a round."""
        most = max(self._first, round((1 + self.surplus) * budget))
        top = round(TOP * rounds) if self.surplus else rounds
        if current <= top:
            return self._first + (most - self._first) * current // top
        return budget + (most - budget) * (rounds - current) // (rounds - top)

    def state_dict(self) -> dict[str, Any]:
        return {"round": self._round, "first": self._first}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        self._round, self._first = state["round"], state["first"]
