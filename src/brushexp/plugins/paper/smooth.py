"""Paint on a smooth ground, which strokes cover without gaps."""

import torch
from torch import Tensor

from brushexp.plugins.paper.base import Paper, Rows
from brushexp.registry import register


@register("paper", "smooth")
class Smooth(Paper):
    """No paper: a smooth ground that does not change the look of the strokes."""

    is_smooth = True

    def cover(self, flat: Tensor, bare: Tensor, rows: Rows) -> Tensor:
        return flat

    def relief(self, rows: Rows) -> Tensor:
        return torch.zeros(rows.count, rows.size[1])
