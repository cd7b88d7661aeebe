"""Losses that compare pixel with pixel."""

from torch import Tensor

from brushexp.plugins.loss.base import Loss, PaintedView
from brushexp.registry import register


@register("loss", "mse")
class MeanSquaredError(Loss):
    """Mean squared difference over pixels and channels (thesis 2020, eq. 6.22)."""

    cost = "1.0 x mse"

    def __init__(self, *, weight: float = 1.0) -> None:
        super().__init__(weight)

    def forward(self, painting: PaintedView) -> Tensor:
        return painting.mean((painting.image - painting.target).square())


@register("loss", "l1")
class MeanAbsoluteError(Loss):
    """Mean absolute difference over pixels and channels (L1); less sensitive to outliers than ``mse``."""

    cost = "1.0 x mse"

    def __init__(self, *, weight: float = 1.0) -> None:
        super().__init__(weight)

    def forward(self, painting: PaintedView) -> Tensor:
        return painting.mean((painting.image - painting.target).abs())
