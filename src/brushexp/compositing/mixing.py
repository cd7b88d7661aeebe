"""A blend in a colour space: strokes are brought into its channels, and the finished picture back from them."""

import torch
from torch import Tensor

from brushexp.compositing.layers import Layers, Size
from brushexp.plugins.blend.base import Blend, Canvas
from brushexp.plugins.color.base import ColorSpace


def mixing(blend: Blend, space: ColorSpace) -> Blend:
    """The same blend in a colour space."""
    return blend.plain if space.is_rgb else MixingBlend(blend.plain, space)


class MixingBlend(Blend):
    """Lays strokes over each other as another blend does, channel by channel of a colour space.

    The accuracy of a stroke is that of its own colour, which no other is laid over: it is the same in every space. Of
    its importance nothing is known here: the error of the channels ranks strokes otherwise than that of the picture.
    """

    def __init__(self, blend: Blend, space: ColorSpace) -> None:
        self.blend, self.layered = blend, blend.layered
        self.space: ColorSpace = space

    @property
    def plain(self) -> Blend:
        return self.blend

    def __call__(
        self, layers: Layers, front_to_back: Tensor, size: Size, background: Tensor, target: Tensor | None = None
    ) -> Canvas:
        bare = self.space.encode(background.to(layers.color))
        channels = self.blend(layers.encoded(self.space.encode), front_to_back, size, bare).image
        image = self.space.decode(channels)
        if target is None:
            return Canvas(image)
        with torch.no_grad():
            return Canvas(image, self.blend(layers, front_to_back, size, background, target).accuracy)
