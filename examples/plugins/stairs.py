"""Optimiser plugin in a single file: ``optimizer=stairs``."""

from collections.abc import Iterable
from typing import Annotated

from torch import nn, optim

from brushexp.contracts import above, between, register
from brushexp.contracts.families import Optimizer


@register("optimizer", "stairs")
class Stairs(Optimizer):
    """Adam with a learning rate that is halved several times.

    Args:
        lr: learning rate, the distance that a step moves the points of a stroke, in half-windows.
        stairs: number of times that the learning rate is halved.
    """

    def __init__(self, *, lr: Annotated[float, above(0)] = 0.02, stairs: Annotated[int, between(0, 20)] = 3) -> None:
        self.lr = lr
        self.stairs = stairs
        self.units = dict.fromkeys(("position", "start", "control", "end", "color", "opacity"), 1.0) | {"width": 0.3}

    def over(self, parameters: Iterable[nn.Parameter]) -> optim.Optimizer:
        return optim.Adam(parameters, lr=self.lr)

    def share(self, progress: float) -> float:
        return 0.5 ** int(progress * (self.stairs + 1))
