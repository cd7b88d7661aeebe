"""Small strokes on top."""

from torch import Tensor

from brushexp.plugins.order.base import Order, every_or_refuse
from brushexp.registry import register
from brushexp.strokes.bezier import curve_of, half_width_of, length_of
from brushexp.strokes.catalogue import Strokes


@register("order", "area")
class Area(Order):
    """Small strokes on top of large ones, as painters work from the general to the particular.

    Args:
        every: steps between two computations, at least 1.
    """

    def __init__(self, *, every: int = 50) -> None:
        self.every = every_or_refuse(every)
        self.needs_accuracy = False

    def depth(self, strokes: Strokes, accuracy: Tensor | None) -> Tensor:
        width = 2 * half_width_of(strokes)
        return -width * (length_of(curve_of(strokes)) + width)
