"""Colour space plugin in a single file: ``color=gamma``."""

from typing import Annotated

from torch import Tensor

from brushexp.contracts import above, register
from brushexp.contracts.families import ColorSpace


@register("color", "gamma")
class Gamma(ColorSpace):
    """Powers of the sRGB values: mixtures are lighter with exponents above 1, and darker with exponents below 1.

    Args:
        exponent: exponent of each channel.
    """

    mixes = "light grey"

    def __init__(self, *, exponent: Annotated[float, above(0, 10)] = 2.0) -> None:
        self.exponent = exponent

    def encode(self, color: Tensor) -> Tensor:
        return color.clamp(1e-6, 1) ** self.exponent  # the root has no slope at 0

    def decode(self, picture: Tensor) -> Tensor:
        return picture.clamp(1e-6, 1) ** (1 / self.exponent)
