"""Order strokes by how closely their colours match the target."""

from dataclasses import dataclass
from typing import Annotated

import torch
from torch import Tensor

from brushexp.contracts import at_least, between, register
from brushexp.contracts.families import RENEWED_SHARE, Order
from brushexp.contracts.strokes import Strokes


@register("order", "accuracy")
@dataclass(kw_only=True)
class Accuracy(Order):
    """Put on top the strokes whose colours best match the target in the area they cover (thesis 2020, eq. 6.6).

    Args:
        every: number of steps between computations of the order, at least 1; 1 in the thesis.
        until: fraction of a stage's steps after which the order stays fixed, 0 to 1; 1 in the thesis.
    """

    every: Annotated[int, at_least(1)] = 10
    until: Annotated[float, between(0, 1)] = RENEWED_SHARE
    needs_accuracy = True

    def depth(self, strokes: Strokes, accuracy: Tensor | None) -> Tensor:
        return torch.zeros_like(strokes.opacity) if accuracy is None else accuracy
