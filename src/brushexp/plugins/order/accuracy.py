"""The thesis's order: what matches the target lies on top."""

import torch
from torch import Tensor

from brushexp.plugins.order.base import Order, every_or_refuse
from brushexp.registry import register
from brushexp.strokes.catalogue import Strokes


@register("order", "accuracy")
class Accuracy(Order):
    """The stroke that is nearer to the target in colour, over all it covers, lies on top (thesis 2020, eq. 6.6).

    Args:
        every: steps between two computations, at least 1; the thesis renews the order after every step.
    """

    def __init__(self, *, every: int = 10) -> None:
        self.every = every_or_refuse(every)
        self.needs_accuracy = True

    def depth(self, strokes: Strokes, accuracy: Tensor | None) -> Tensor:
        return torch.zeros_like(strokes.opacity) if accuracy is None else accuracy
