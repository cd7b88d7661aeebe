"""Order plugin in a single file: ``order=lightest``."""

from typing import Annotated

from torch import Tensor

from brushexp.contracts import at_least, register
from brushexp.contracts.families import Order
from brushexp.contracts.strokes import Strokes


@register("order", "lightest")
class Lightest(Order):
    """Light strokes are above dark strokes, because painters add highlights last.

    Args:
        every: number of steps between two updates of the order.
    """

    def __init__(self, *, every: Annotated[int, at_least(1)] = 20) -> None:
        self.every = every

    def depth(self, strokes: Strokes, accuracy: Tensor | None) -> Tensor:
        return strokes.color.mean(1)
