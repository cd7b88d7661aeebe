"""Place strokes on a lattice."""

import math
from dataclasses import dataclass
from typing import Annotated

import numpy as np
import torch
from torch import Tensor

from brushexp.bounds import above
from brushexp.plugins.init._cells import CellInitializer
from brushexp.registry import register


@register("init", "grid")
@dataclass(kw_only=True)
class Grid(CellInitializer):
    """Places one stroke in each cell of a regular lattice; see also the ``overlapping_grid`` preset.

    Args:
        shift: whether every other row is shifted by half a cell.
    """

    shift: bool = False
    length: Annotated[float, above(0, 10)] = 1.0

    def cells(self, target: Tensor, n: int, generator: torch.Generator, focus: Tensor | None) -> np.ndarray:
        return lattice(target.shape[1], target.shape[2], n, shift=self.shift)


def lattice(height: int, width: int, n: int, *, shift: bool = False) -> np.ndarray:
    """Assign each pixel (H, W) to one of exactly ``n`` nearly square cells of a lattice.

    The numbers of cells in any two rows differ by at most one. With ``shift``, rows are shifted by a quarter of a cell,
    alternately right and left, and the cells at the edges of the canvas are narrower or wider.
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
