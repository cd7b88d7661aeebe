"""Keep the picture's own colours."""

from torch import Tensor

from brushexp.plugins.palette.base import Palette
from brushexp.registry import register


@register("palette", "own")
class Own(Palette):
    """Keeps the picture's own colours."""

    def __call__(self, picture: Tensor) -> Tensor:
        return picture
