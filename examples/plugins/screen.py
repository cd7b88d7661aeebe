"""Paper plugin in a single file: ``paper=screen``."""

from typing import Annotated

import torch
from torch import Tensor

from brushexp.contracts import between, register
from brushexp.contracts.families import Paper, Rows

DEEP = 0.002  # of a hole, in longer sides of the canvas


@register("paper", "screen")
class Screen(Paper):
    """A sheet with round holes that stay free of paint.

    Args:
        holes: number of holes along the longer side of the canvas.
        wide: diameter of a hole, as a fraction of the distance between neighbouring holes.
    """

    def __init__(
        self, *, holes: Annotated[int, between(1, 1000)] = 40, wide: Annotated[float, between(0, 1)] = 0.5
    ) -> None:
        self.holes = holes
        self.wide = wide

    def cover(self, flat: Tensor, bare: Tensor, rows: Rows) -> Tensor:
        return torch.where(self._is_hole(rows).to(flat.device), bare[:, None, None], flat)

    def relief(self, rows: Rows) -> Tensor:
        return DEEP * max(rows.size) * (~self._is_hole(rows)).float()

    def _is_hole(self, rows: Rows) -> Tensor:
        x, y = (self.holes * place % 1 - 0.5 for place in rows.places)
        return torch.hypot(x, y) < self.wide / 2
