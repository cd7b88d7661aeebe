"""Penalise strokes with impure colours."""

from typing import Annotated

from torch import Tensor

from brushexp.contracts import between, register
from brushexp.contracts.families import Loss, PaintedView
from brushexp.contracts.strokes import at_least_single


@register("loss", "chroma")
class Chroma(Loss):
    """Mean of max(0, least - C)^2 over all strokes, where C is the range of a colour's RGB values; avoids grey paint.

    In combination with `blurred`, neighbouring strokes reproduce a less pure colour with different hues that average
    to it.

    Args:
        least: chroma from which a colour counts as pure, 0 to 1.
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
