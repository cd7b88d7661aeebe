"""Penalise the mean squared error."""

from torch import Tensor

from brushexp.plugins.loss.base import Loss, PaintedView
from brushexp.registry import register


@register("loss", "mse")
class MeanSquaredError(Loss):
    """Mean squared difference over pixels and channels.

    Source: thesis 2020, eq. 6.22, which sums over the three channels and is therefore three times as large.
    """

    cost = "1.0 x mse"

    def forward(self, view: PaintedView) -> Tensor:
        return view.mean((view.image - view.target).square())
