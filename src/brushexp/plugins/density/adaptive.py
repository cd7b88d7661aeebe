"""Strokes where the picture needs them."""

import logging
import math
from typing import Annotated, Any

from brushexp.bounds import at_least, between
from brushexp.plugins.density._candidates import candidates, halves, straddling
from brushexp.plugins.density.base import DensificationState, DensificationUpdate, Density
from brushexp.registry import register
from brushexp.strokes.catalogue import Strokes

CHANNELS = 3
SMALLEST_SHARE = 1e-3  # of the strokes to begin with: none would be nothing to begin with
SMALLEST_PITCHES = 1e-3  # size of a new stroke
STEPS_BETWEEN_ROUNDS = 8  # at least: strokes must have found their place before they are judged

log = logging.getLogger(__name__)


@register("density", "adaptive")
class Adaptive(Density):
    """Start with fewer strokes, add small ones where the error is, move there those that matter least.

    In each of some rounds the strokes without which the picture would lose least are taken away, and new ones are laid
    at the worst places, in the picture's colour and along its edges; a share of them comes from cutting strokes in two
    that straddle an edge. Strokes of no importance, hidden ones for instance, go in any case. So flat regions
    keep few large strokes, and detail gets many small ones. Kept strokes keep what the optimiser knows of them.

    Like GaussianImage++ (2025) it adds at the worst pixels, and like the densification of 3D Gaussian splatting (Kerbl
    et al., 2023) it adds and removes in turns. It differs from both in what it removes: the importance of a stroke
    is how much the squared error would grow without it, and not its opacity; and in that it goes on replacing strokes
    when their full number is reached.

    Args:
        start: share of the strokes to begin with, above 0 to 1.
        rounds: times at which strokes are added and removed; fewer if there would be less than 8 steps between them.
        until: share of the steps after which the strokes stay.
        moved: share of the strokes that is taken away in each round and laid elsewhere, 0 to 0.5.
        split: share of the new strokes that come from cutting one in two, 0 to 1.
        size: of new strokes, in pitches (mean distances between strokes).
        tolerance: places whose error (root mean square over a stroke, 0 to 1) is below this need no more strokes, so
            that a simple picture ends with fewer than it may have.
        psnr: dB from which no more strokes are added; null for none.
    """

    uses_importance = True

    def __init__(
        self,
        *,
        start: Annotated[float, between(SMALLEST_SHARE, 1)] = 0.7,
        rounds: Annotated[int, at_least(0)] = 12,
        until: Annotated[float, between(0, 1)] = 0.75,
        moved: Annotated[float, between(0, 0.5)] = 0.1,
        split: Annotated[float, between(0, 1)] = 0.0,
        size: Annotated[float, between(SMALLEST_PITCHES, 10)] = 0.25,
        tolerance: Annotated[float, between(0, 1)] = 0.004,
        psnr: float | None = None,
    ) -> None:
        self.start = start
        self.rounds = rounds
        self.until = until
        self.moved = moved
        self.split = split
        self.size = size
        self.tolerance = tolerance
        self.psnr = math.inf if psnr is None else psnr
        self._round = 0  # of those that are over
        self._first = 0  # strokes at the beginning

    def first(self, budget: int, steps: int) -> int:
        return max(1, round(self.start * budget)) if self._rounds(steps) else budget

    def _rounds(self, steps: int) -> int:
        return min(self.rounds, int(self.until * steps / STEPS_BETWEEN_ROUNDS))

    def revise(self, state: DensificationState) -> DensificationUpdate | None:
        n, rounds = len(state.strokes), self._rounds(state.steps)
        self._first = self._first or n
        current = min(rounds, int(rounds * state.step / (self.until * state.steps))) if rounds else 0
        if current <= self._round or state.step >= state.steps:
            return None
        self._round = current
        if _psnr(state) >= self.psnr:
            return None
        wanted = self._first + max(0, state.budget - self._first) * current // rounds
        importance = state.importance()
        keep = importance > CHANNELS * self.tolerance**2  # the others gain less than a pixel that is good enough
        if n:
            keep[importance.argmax()] = True
        more = max(0, wanted - int(keep.sum()))
        weakest = importance.where(keep, math.inf).argsort(stable=True)[
            : max(0, min(round(self.moved * n), int(keep.sum()) - 1))
        ]
        found = candidates(state, more + len(weakest), self.size, self.tolerance)
        keep[weakest[: max(0, len(found) - more)]] = False
        able = keep & (importance > importance.median()) if n else keep
        cut = straddling(state).where(able, -1.0).topk(min(int(self.split * len(found)), int(able.sum()))).indices
        keep[cut] = False
        new = Strokes.join(halves(state.strokes[cut]), found[: len(found) - len(cut)].strokes(state))
        log.debug("step %d: %d strokes, %d added, %d dropped", state.step, n, len(new), n - int(keep.sum()))
        return DensificationUpdate(keep, new) if len(new) or not keep.all() else None

    def state_dict(self) -> dict[str, Any]:
        return {"round": self._round, "first": self._first}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        self._round, self._first = state["round"], state["first"]


def _psnr(state: DensificationState) -> float:
    error = float((state.image - state.target).square().mean())
    return -10 * math.log10(error) if error else math.inf
