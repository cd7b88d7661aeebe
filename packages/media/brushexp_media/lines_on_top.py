"""Put the pen lines of a drawing on top of its washes."""

from torch import Tensor

from brushexp.contracts import register
from brushexp.contracts.families import ONCE, Order
from brushexp.contracts.strokes import Strokes
from brushexp_media.marks import is_line


@register("order", "lines")
class LinesOnTop(Order):
    """Puts pen lines on top of all washes, also of those in faces; otherwise keeps the order of the catalogue."""

    every = ONCE

    def depth(self, strokes: Strokes, accuracy: Tensor | None) -> Tensor:
        return is_line(strokes).to(strokes.opacity.dtype)
