"""Strokes on a lattice."""

import math
from typing import Annotated

import numpy as np
import torch
from torch import Tensor

from brushexp.bounds import above, between
from brushexp.plugins.init._cells import Look, Orient, strokes_of_cells
from brushexp.plugins.init.base import Initializer
from brushexp.registry import register
from brushexp.strokes.catalogue import Strokes


@register("init", "grid")
class Grid(Initializer):
    """A lattice of equal cells, with a stroke in each; preset ``overlapping_grid``.

    Args:
        shift: move every other row by half a cell.
        orient: structure (along the picture's edges) or random (the thesis's).
        length: of a stroke, in sides of its cell (structure only).
        width: of a stroke, in sides of its cell (structure only).
        opacity: 0 to 1.
        jitter: random shift of each stroke in mean distances between strokes, so that seeds differ.
    """

    def __init__(
        self,
        *,
        shift: bool = False,
        orient: Orient = Orient.structure,
        length: Annotated[float, above(0, 10)] = 1.0,
        width: Annotated[float, above(0, 10)] = 1.0,
        opacity: Annotated[float, between(0, 1)] = 0.95,
        jitter: Annotated[float, between(0, 10)] = 0.02,
    ) -> None:
        self.shift = shift
        self.look = Look(orient, length, width, opacity, jitter)

    def __call__(
        self, target: Tensor, n_strokes: int, generator: torch.Generator, focus: Tensor | None = None
    ) -> Strokes:
        labels = lattice(target.shape[1], target.shape[2], n_strokes, shift=self.shift)
        return strokes_of_cells(target, labels, n_strokes, self.look, generator)


def lattice(height: int, width: int, n: int, *, shift: bool = False) -> np.ndarray:
    """Number (H, W) of each pixel's cell in a lattice of exactly ``n`` nearly square cells.

    Rows differ by one cell at most. With ``shift`` rows are moved by a quarter of a cell, to the right and to the left
    in turn; the cells at the edge of the canvas make up for it.
    """
    rows = min(n, height, max(math.ceil(n / width), round(math.sqrt(n * height / width)), 1))
    counts = np.full(rows, n // rows)
    counts[: n % rows] += 1
    first = np.concatenate([[0], np.cumsum(counts)[:-1]])
    row = np.arange(height) * rows // height
    place = (np.arange(width) + 0.5) / width * counts[row][:, None]  # (H, W), in cells
    if shift:
        place = place + np.where(row % 2 == 1, -0.25, 0.25)[:, None]
    column = np.clip(place.astype(np.int64), 0, counts[row][:, None] - 1)
    return first[row][:, None] + column
