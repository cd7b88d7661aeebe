"""Order strokes by size."""

from dataclasses import dataclass
from typing import Annotated

from torch import Tensor

from brushexp.bounds import at_least, between
from brushexp.plugins.order.base import RENEWED_SHARE, Order
from brushexp.registry import register
from brushexp.strokes.bezier import curve_of, half_width_of, length_of
from brushexp.strokes.catalogue import Strokes


@register("order", "area")
@dataclass(kw_only=True)
class Area(Order):
    """Puts small strokes on top of large ones, just as painters work from the general to the particular.

    Args:
        every: number of steps after which the order is recomputed, at least 1.
        until: fraction of a stage's steps after which the order is fixed, 0 to 1.
    """

    every: Annotated[int, at_least(1)] = 50
    until: Annotated[float, between(0, 1)] = RENEWED_SHARE

    def depth(self, strokes: Strokes, accuracy: Tensor | None) -> Tensor:
        width = 2 * half_width_of(strokes)
        return -width * (length_of(curve_of(strokes)) + width)
