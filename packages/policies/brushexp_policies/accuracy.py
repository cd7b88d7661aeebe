"""Order strokes by their nearness to the target in colour."""

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
    """The stroke that is nearer to the target in colour, over all it covers, lies on top (thesis 2020, eq. 6.6).

    Args:
        every: steps between two computations, at least 1; the thesis renews the order after every step.
        until: share of a stage's steps after which the order stays, 0 to 1; the thesis: 1.
    """

    every: Annotated[int, at_least(1)] = 10
    until: Annotated[float, between(0, 1)] = RENEWED_SHARE
    needs_accuracy = True

    def depth(self, strokes: Strokes, accuracy: Tensor | None) -> Tensor:
        return torch.zeros_like(strokes.opacity) if accuracy is None else accuracy
