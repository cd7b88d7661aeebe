"""Test whether fewer strokes suffice for a painting that is good enough."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import torch
from torch import Tensor

from brushexp.plugins.density.base import DensificationState, DensificationUpdate
from brushexp.strokes.catalogue import Strokes

FIRST_SHARE = 0.1  # share of the strokes that the first trial leaves out; half as many after each failure
LEAST_SHARE = 0.01  # smallest share of the strokes that a trial leaves out
MOST_FAILURES = 4  # largest number of consecutive trials that may fail


@dataclass
class Trials:
    """Tentatively removes strokes, and restores the best painting so far if the others cannot make up for them.

    The best painting is the one that is good enough with the fewest strokes. It is stored as ``strokes`` (N,), bottom
    stroke first, and the ``importance`` (N,) of each stroke; both are None until a painting is good enough.
    """

    strokes: Strokes | None = field(default=None)
    importance: Tensor | None = field(default=None)
    failures: int = field(default=0)  # number of consecutive failed trials

    def next(self, state: DensificationState, slack: float, steps: int | None) -> DensificationUpdate | None:
        """Return the next trial or, after the last trial, the best painting; None if ``state`` is already the best.

        A painting is good enough if its ``slack``, the amount by which its squared error may grow, is 0 or more; this
        must hold for the first painting. A trial extends the painting to ``steps`` steps; if ``steps`` is None, no
        trial is possible.
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
            tried = sum(_count(n, failed) == count for failed in range(self.failures)) * count  # as small as this one
            ranks = self.importance.argsort(stable=True)
            spared = min(tried, n - count)
            rest = torch.cat([ranks[:spared], ranks[spared + count :]]).sort().values
        return DensificationUpdate(
            torch.zeros(len(state.strokes), dtype=torch.bool, device=device), self.strokes[rest], steps
        )

    def _from_best(self, state: DensificationState, slack: float, steps: int | None) -> DensificationUpdate | None:
        """Store a painting that is good enough, and tentatively remove its least important strokes."""
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
    """Return how many of ``n`` strokes to remove in a trial after ``failures`` failed trials."""
    return max(1, round(LEAST_SHARE * n), round(FIRST_SHARE * n / 2**failures))
