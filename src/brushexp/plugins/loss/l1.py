"""Penalise the mean absolute error."""

from torch import Tensor

from brushexp.plugins.loss.base import Loss, PaintedView
from brushexp.registry import register


@register("loss", "l1")
class MeanAbsoluteError(Loss):
    """Mean absolute difference over pixels and channels (L1); less sensitive to outliers than ``mse``."""

    cost = "1.0 x mse"

    def forward(self, view: PaintedView) -> Tensor:
        return view.mean((view.image - view.target).abs())
