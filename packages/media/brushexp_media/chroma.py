"""Purity of the strokes' colours as a loss."""

from typing import Annotated

from torch import Tensor

from brushexp.contracts import between, register
from brushexp.contracts.families import Loss, PaintedView
from brushexp.contracts.strokes import at_least_single


@register("loss", "chroma")
class Chroma(Loss):
    """Mean of max(0, least - C)^2 over the strokes, C the largest minus the smallest part of RGB: no paint is grey.

    With `blurred`, neighbours of a colour that is less pure go apart in hue, and their mean is that colour.

    Args:
        least: chroma from which on a colour is pure enough, 0 to 1.
    """

    weight = 0.02
    cost = "0.5 x mse"
    looks_at = "strokes"

    def __init__(self, *, least: Annotated[float, between(0, 1)] = 0.45) -> None:
        super().__init__()
        self.least = least

    def forward(self, view: PaintedView) -> Tensor:
        color = at_least_single(view.strokes.color)
        chroma = color.amax(1) - color.amin(1)
        return (self.least - chroma).clamp_min(0).square().sum() / max(len(color), 1)
