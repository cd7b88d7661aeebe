"""Keep the stroke order of the catalogue."""

import torch
from torch import Tensor

from brushexp.plugins.order.base import ONCE, Order
from brushexp.registry import register
from brushexp.strokes.catalogue import Strokes


@register("order", "fixed")
class FixedOrder(Order):
    """Keeps the stroke order of the catalogue, whose last stroke is on top."""

    every = ONCE

    def depth(self, strokes: Strokes, accuracy: Tensor | None) -> Tensor:
        return torch.zeros_like(strokes.opacity)
