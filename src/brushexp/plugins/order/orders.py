"""Orders: by colour, by size, or as the strokes come."""

from dataclasses import dataclass
from typing import Annotated

import torch
from torch import Tensor

from brushexp.bounds import at_least, between
from brushexp.plugins.order.base import UNTIL, Order
from brushexp.registry import register
from brushexp.strokes.bezier import curve_of, half_width_of, length_of
from brushexp.strokes.catalogue import Strokes


@register("order", "accuracy")
@dataclass(kw_only=True)
class Accuracy(Order):
    """The stroke that is nearer to the target in colour, over all it covers, lies on top (thesis 2020, eq. 6.6).

    Args:
        every: steps between two computations, at least 1; the thesis renews the order after every step.
        until: share of a stage's steps after which the order stays, 0 to 1; the thesis: 1.
    """

    every: Annotated[int, at_least(1)] = 10
    until: Annotated[float, between(0, 1)] = UNTIL
    needs_accuracy = True

    def depth(self, strokes: Strokes, accuracy: Tensor | None) -> Tensor:
        return torch.zeros_like(strokes.opacity) if accuracy is None else accuracy


@register("order", "area")
@dataclass(kw_only=True)
class Area(Order):
    """Small strokes on top of large ones, as painters work from the general to the particular.

    Args:
        every: steps between two computations, at least 1.
        until: share of a stage's steps after which the order stays, 0 to 1.
    """

    every: Annotated[int, at_least(1)] = 50
    until: Annotated[float, between(0, 1)] = UNTIL

    def depth(self, strokes: Strokes, accuracy: Tensor | None) -> Tensor:
        width = 2 * half_width_of(strokes)
        return -width * (length_of(curve_of(strokes)) + width)


@register("order", "fixed")
class FixedOrder(Order):
    """As the strokes come: the last one of the catalogue on top."""

    every = 2**31  # never again

    def depth(self, strokes: Strokes, accuracy: Tensor | None) -> Tensor:
        return torch.zeros_like(strokes.opacity)
