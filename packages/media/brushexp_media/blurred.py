"""Mean squared error between blurred pictures."""

import math
from typing import Annotated

from torch import Tensor

from brushexp.contracts import between, register
from brushexp.contracts.families import Loss, PaintedView
from brushexp_media.picture.smoothing import gaussian_blur


@register("loss", "blurred")
class Blurred(Loss):
    """Mean squared difference between painting and target, both blurred as if seen from afar.

    Detail finer than the blur is unconstrained: only the mean of dots and lines has to match the picture, because the
    eye mixes them (optical mixture: Signac, "D'Eugène Delacroix au néo-impressionnisme", 1899).

    Args:
        sigma: standard deviation of the Gaussian, in pixels.
    """

    cost = "not measured"

    def __init__(self, *, sigma: Annotated[float, between(0.1, 100)] = 4.0) -> None:
        super().__init__()
        self.sigma = sigma
        self.context = 2 * math.ceil(3 * sigma)  # a pixel affects the blur around it, and its neighbours' blur as well

    def forward(self, view: PaintedView) -> Tensor:
        target = self.of_target(view.target, lambda target: gaussian_blur(target, self.sigma))
        return view.mean((gaussian_blur(view.image, self.sigma) - target).square())
