"""Place new strokes where the error is largest."""

import math

import numpy as np
import torch

from brushexp.pictures.structure import along_edges, structure_tensor, worst_of_cells
from brushexp.plugins.density.base import DensificationState
from brushexp.strokes.catalogue import Strokes

BLUR = 0.45  # blur of the error, relative to the size of a new stroke
SPACING = 2.5  # approximate minimum distance between new strokes, relative to their size
LENGTH, THICKNESS = 1.4, 0.8  # dimensions of a new stroke relative to its size, as in the initialisers
OPACITY = 0.95
STRUCTURE = 1.5  # pixels over which the direction of the picture is measured


def new_strokes(state: DensificationState, n: int, size: float, tolerance: float) -> Strokes:
    """Create up to ``n`` strokes where the error is largest, worst place first, at most one in each lattice cell.

    The strokes have the target's colour and follow its edges; ``size`` and ``tolerance`` are the options of
    density=adaptive.
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
