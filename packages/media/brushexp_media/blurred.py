"""The mean squared error of blurred pictures."""

import math
from typing import Annotated

from torch import Tensor

from brushexp.contracts import between, register
from brushexp.contracts.families import Loss, PaintedView
from brushexp_media.picture.smoothing import gaussian_blur


@register("loss", "blurred")
class Blurred(Loss):
    """Mean squared difference of the painting and its target, both seen from afar.

    What is finer than the blur is free: dots and lines need only have the mean of the picture, as the eye mixes them
    (optical mixture: Signac, "D'Eugène Delacroix au néo-impressionnisme", 1899).

    Args:
        sigma: deviation of the Gaussian in pixels of the picture.
    """

    cost = "not measured"

    def __init__(self, *, sigma: Annotated[float, between(0.1, 100)] = 4.0) -> None:
        super().__init__()
        self.sigma = sigma
        self.context = 2 * math.ceil(3 * sigma)  # a pixel counts where it is blurred, and there its neighbours do

    def forward(self, view: PaintedView) -> Tensor:
        target = self.of_target(view.target, lambda target: gaussian_blur(target, self.sigma))
        return view.mean((gaussian_blur(view.image, self.sigma) - target).square())
