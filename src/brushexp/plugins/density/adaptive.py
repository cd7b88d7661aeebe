"""Add strokes where the error is largest, and remove those that matter least."""

import math
from dataclasses import dataclass
from typing import Annotated

import numpy as np
import torch
from torch import Tensor

from brushexp.bounds import at_least, between
from brushexp.pictures.structure import along_edges, structure_tensor, worst_of_cells
from brushexp.plugins.density.base import DensificationState
from brushexp.plugins.density.rounds import Rounds
from brushexp.registry import register
from brushexp.strokes.catalogue import Strokes

MIN_PITCHES = 1e-3  # least size of a new stroke
BLUR = 0.45  # blur of the error, in sizes of a new stroke
SPACING = 2.5  # least distance of new strokes, roughly, in their sizes
LENGTH, THICKNESS = 1.4, 0.8  # of a new stroke, in its size, as the initialisers have it
OPACITY = 0.95
STRUCTURE = 1.5  # pixels over which the picture's direction is measured


@register("density", "adaptive")
@dataclass(kw_only=True)
class Adaptive(Rounds):
    """Start with fewer strokes, add small ones where the error is, move there those that matter least.

    Each round removes the strokes without which the squared error grows least, and hidden ones in any case, and adds
    new ones at the worst places, in the picture's colour and along its edges.

    Source: GaussianImage++ (2025), which adds at the worst pixels, and 3D Gaussian splatting (Kerbl et al., 2023),
    which adds and removes in turns. Differs from both: it removes by importance, not by opacity, and goes on replacing
    strokes when there are as many as there may be.

    Args:
        start: share of the strokes to begin with, above 0 to 1.
        rounds: times at which strokes are added and removed, with 8 steps at least between them.
        until: share of the steps after which the strokes stay.
        moved: share of the strokes that each round lays elsewhere, 0 to 0.5.
        size: of new strokes, in pitches (mean distances between strokes).
        tolerance: error (root mean square over a stroke, 0 to 1) below which a place needs no more strokes.
        surplus: share by which there are more strokes on the way than in the end, 0 to 3; the least important go.
        psnr: dB from which no more strokes are added; null for none.
    """

    size: Annotated[float, between(MIN_PITCHES, 10)] = 0.25
    psnr: Annotated[float | None, at_least(0)] = None

    def is_good_enough(self, state: DensificationState) -> bool:
        wanted = 0.0 if self.psnr is None else 10 ** (-self.psnr / 10)  # mean squared error
        return bool((state.image - state.target).square().mean() <= wanted)

    def replaced(self, state: DensificationState, missing: int, weakest: Tensor) -> tuple[Strokes, int]:
        new = new_strokes(state, missing + len(weakest), self.size, self.tolerance)
        return new, max(0, len(new) - missing)


def new_strokes(state: DensificationState, n: int, size: float, tolerance: float) -> Strokes:
    """Make strokes at the ``n`` worst places, or fewer, the worst first, one in a cell of a lattice at most.

    They have the target's colour and lie along its edges; ``size`` and ``tolerance`` are those of `Adaptive`.
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
