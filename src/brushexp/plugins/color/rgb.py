"""Mix paint in the colour space of picture files."""

from torch import Tensor

from brushexp.plugins.color.base import ColorSpace
from brushexp.registry import register


@register("color", "rgb")
class Rgb(ColorSpace):
    """Mixes the sRGB values of the picture file, as most programs do."""

    cost, mixes, is_rgb = "1", "grey", True

    def encode(self, color: Tensor) -> Tensor:
        return color

    def decode(self, picture: Tensor) -> Tensor:
        return picture
