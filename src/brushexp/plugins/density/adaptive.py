"""Strokes where the picture needs them."""

import logging
import math
from dataclasses import dataclass, field
from typing import Annotated, Any

import numpy as np
import torch

from brushexp.bounds import at_least, between
from brushexp.pictures.structure import along_edges, structure_tensor, worst_of_cells
from brushexp.plugins.density.base import DensificationState, DensificationUpdate, Density
from brushexp.registry import register
from brushexp.strokes.catalogue import Strokes

CHANNELS = 3
SMALLEST_SHARE = 1e-3  # of the strokes to begin with: none would be nothing to begin with
SMALLEST_PITCHES = 1e-3  # size of a new stroke
STEPS_BETWEEN_ROUNDS = 8  # at least: strokes must have found their place before they are judged
BLUR = 0.45  # of the error, in sizes of a new stroke
SPACING = 2.5  # sizes of a new stroke between two of them at least, roughly
LENGTH, THICKNESS = 1.4, 0.8  # of a new stroke, in its size: as the initialisers lay them
OPACITY = 0.95
STRUCTURE = 1.5  # pixels over which the picture's direction is read

log = logging.getLogger(__name__)


@register("density", "adaptive")
@dataclass(kw_only=True)
class Adaptive(Density):
    """Start with fewer strokes, add small ones where the error is, move there those that matter least.

    In each of some rounds the strokes without which the picture would lose least are taken away, and new ones are laid
    at the worst places, in the picture's colour and along its edges. Strokes of no importance (hidden ones, for
    instance) go in any case. So flat regions keep few large strokes, and detail gets many small ones.

    Like GaussianImage++ (2025) it adds at the worst pixels, and like the densification of 3D Gaussian splatting (Kerbl
    et al., 2023) it adds and removes in turns. It differs from both in what it removes: the importance of a stroke
    is how much the squared error would grow without it, and not its opacity; and in that it goes on replacing strokes
    when their full number is reached.

    Args:
        start: share of the strokes to begin with, above 0 to 1.
        rounds: times at which strokes are added and removed; fewer if there would be less than 8 steps between them.
        until: share of the steps after which the strokes stay.
        moved: share of the strokes that is taken away in each round and laid elsewhere, 0 to 0.5.
        size: of new strokes, in pitches (mean distances between strokes).
        tolerance: places whose error (root mean square over a stroke, 0 to 1) is below this need no more strokes, so
            that a simple picture ends with fewer than it may have.
        psnr: dB from which no more strokes are added; null for none.
    """

    start: Annotated[float, between(SMALLEST_SHARE, 1)] = 0.7
    rounds: Annotated[int, at_least(1)] = 12
    until: Annotated[float, between(0, 1)] = 0.75
    moved: Annotated[float, between(0, 0.5)] = 0.1
    size: Annotated[float, between(SMALLEST_PITCHES, 10)] = 0.25
    tolerance: Annotated[float, between(0, 1)] = 0.004
    psnr: Annotated[float | None, at_least(0)] = None
    _round: int = field(default=0, init=False)  # of those that are over
    _first: int = field(default=0, init=False)  # strokes at the beginning
    uses_importance = True

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
        good_enough = 0.0 if self.psnr is None else 10 ** (-self.psnr / 10)  # mean squared error
        if (state.image - state.target).square().mean() <= good_enough:
            return None
        importance = state.importance()
        keep = importance > CHANNELS * self.tolerance**2  # the others gain less than a pixel that is good enough
        if n:
            keep[importance.argmax()] = True
        kept = int(keep.sum())
        wanted = self._first + max(0, state.budget - self._first) * current // rounds
        missing, moved = max(0, wanted - kept), max(0, min(round(self.moved * n), kept - 1))
        weakest = importance.where(keep, math.inf).argsort(stable=True)[:moved]
        new = new_strokes(state, missing + moved, self.size, self.tolerance)
        keep[weakest[: max(0, len(new) - missing)]] = False
        log.debug("step %d: %d strokes, %d added, %d dropped", state.step, n, len(new), n - int(keep.sum()))
        return DensificationUpdate(keep, new) if len(new) or not keep.all() else None

    def state_dict(self) -> dict[str, Any]:
        return {"round": self._round, "first": self._first}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        self._round, self._first = state["round"], state["first"]


def new_strokes(state: DensificationState, n: int, size: float, tolerance: float) -> Strokes:
    """Strokes at the ``n`` worst places, or fewer, the worst first: in the target's colour, along its edges.

    There is at most one in each cell of a lattice, where its error is largest. ``size`` (in pitches) and ``tolerance``
    are those of `Adaptive`.
    """
    from scipy.ndimage import gaussian_filter  # noqa: PLC0415  (--help does not need it)

    target, like = state.target.cpu().numpy(), state.strokes.position
    pixels = size * math.sqrt(target[0].size / max(state.budget, 1))
    error = (state.image - state.target).square().mean(0)
    if state.focus is not None:
        error = error * state.focus
    blurred = gaussian_filter(error.cpu().numpy(), BLUR * pixels)
    _, column, row = worst_of_cells(blurred, max(2, round(SPACING * pixels)))
    worst = blurred[row, column]
    order = np.argsort(-worst, kind="stable")[: min(n, int((worst > tolerance**2).sum()))]
    row, column = row[order], column[order]
    angle = like.new_tensor(along_edges(structure_tensor(target, STRUCTURE)[:, row, column]))
    windows = state.strokes.scale if len(state.strokes) else like.new_ones(1)
    scale = windows.median().clamp_min(LENGTH * pixels).repeat(len(order))
    end = torch.stack([angle.cos(), angle.sin()], dim=1) * (LENGTH * pixels / scale)[:, None]
    return Strokes(
        position=like.new_tensor(np.stack([column, row], 1)) + 0.5,
        scale=scale,
        start=-end,
        control=torch.zeros_like(end),
        end=end,
        width=THICKNESS * pixels / scale,
        color=like.new_tensor(target[:, row, column].T).clamp(0, 1),
        opacity=torch.full_like(scale, OPACITY),
    )
