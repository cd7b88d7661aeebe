"""Try whether a painting that is good enough can do with fewer strokes."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import torch
from torch import Tensor

from brushexp.plugins.density.base import DensificationState, DensificationUpdate
from brushexp.strokes.catalogue import Strokes

FIRST_SHARE = 0.1  # share of the strokes that the first trial leaves out; half as many after each failure
LEAST_SHARE = 0.01  # least share of the strokes that a trial leaves out
MOST_FAILURES = 4  # trials in a row that may fail


@dataclass
class Trials:
    """Leaves strokes out for trial, and restores the best painting so far if the others do not make up for them.

    The best painting is the one with the fewest strokes that is good enough: ``strokes`` (N,), from the bottom to the
    top, and the ``importance`` (N,) of each; both are None before there is one.
    """

    strokes: Strokes | None = field(default=None)
    importance: Tensor | None = field(default=None)
    failures: int = field(default=0)  # trials in a row after which the painting was not good enough

    def next(self, state: DensificationState, slack: float, steps: int | None) -> DensificationUpdate | None:
        """Return the next trial, the best painting if there are no more, or None if ``state`` is that painting.

        A painting is good enough if its squared error may grow by ``slack``, 0 or more; the first one must be. A trial
        takes the painting to ``steps``, None if there are none left.
        """
        if slack >= 0:
            return self._from_best(state, slack, steps)
        assert self.strokes is not None
        assert self.importance is not None
        self.failures += 1
        n, device = len(self.strokes), self.importance.device
        if self._is_over(n, steps):
            rest, steps = torch.arange(n, device=device), None
        else:
            count = _count(n, self.failures)
            tried = sum(_count(n, failed) == count for failed in range(self.failures)) * count  # these were as few
            ranks = self.importance.argsort(stable=True)
            spared = min(tried, n - count)
            rest = torch.cat([ranks[:spared], ranks[spared + count :]]).sort().values
        return DensificationUpdate(
            torch.zeros(len(state.strokes), dtype=torch.bool, device=device), self.strokes[rest], steps
        )

    def _from_best(self, state: DensificationState, slack: float, steps: int | None) -> DensificationUpdate | None:
        """Remember a painting that is good enough, and leave out the first strokes."""
        importance, n = state.importance(), len(state.strokes)
        upward = torch.arange(n) if state.front_to_back is None else state.front_to_back.flip(0)
        self.strokes, self.importance = state.strokes[upward].map(Tensor.clone), importance[upward]
        self.failures = 0
        if self._is_over(n, steps):
            return None
        ranks = importance.argsort(stable=True)
        spare = int((importance[ranks].clamp_min(0).cumsum(0) <= slack).sum())
        keep = torch.ones_like(importance, dtype=torch.bool)
        keep[ranks[: min(n - 1, max(spare, _count(n, 0)))]] = False
        return DensificationUpdate(keep, Strokes.none(state.strokes.position), steps)

    def _is_over(self, n: int, steps: int | None) -> bool:
        return steps is None or n == 1 or self.failures == MOST_FAILURES

    def state_dict(self) -> dict[str, Any]:
        """Return plain data from which `load_state_dict` restores the trials."""
        if self.strokes is None:
            return {}
        fields = dict(self.strokes.items()) | {"brush": self.strokes.brush}
        return {"strokes": fields, "importance": self.importance, "failures": self.failures}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Load the result of `state_dict`."""
        if state:
            self.strokes, self.importance = Strokes(**state["strokes"]), state["importance"]
            self.failures = state["failures"]


def _count(n: int, failures: int) -> int:
    """Return how many of ``n`` strokes a trial leaves out."""
    return max(1, round(LEAST_SHARE * n), round(FIRST_SHARE * n / 2**failures))
