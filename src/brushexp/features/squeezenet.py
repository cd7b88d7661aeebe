"""SqueezeNet 1.1, the lightest of the classic networks, from weights that the user has."""

from collections.abc import Iterator

import torch
from torch import Tensor, nn
from torch.nn import functional

from brushexp.features.base import Backbone, FrozenConvolution, Normalise, widened
from brushexp.features.weights import IMAGENET_SCALE, IMAGENET_SHIFT, OPTION, Layers, check_shapes, read_layers

# Of each module "fire": its place in torchvision's `features`, the channels before, inside, and of each of its halves.
FIRES = (
    (3, 64, 16, 64),
    (4, 128, 16, 64),
    (6, 128, 32, 128),
    (7, 256, 32, 128),
    (9, 256, 48, 192),
    (10, 384, 48, 192),
    (11, 384, 64, 256),
    (12, 512, 64, 256),
)
TAPS = ("relu1", *(f"fire{i}" for i in range(2, 10)))
POOLED = ("relu1", "fire3", "fire5")  # what is pooled, 3 x 3 by 2, up to and with an incomplete window at the end
SHAPES = {"features.0": (64, 3, 3, 3)} | {
    f"features.{place}.{part}": shape
    for place, before, inside, half in FIRES
    for part, shape in (
        ("squeeze", (inside, before, 1, 1)),
        ("expand1x1", (half, inside, 1, 1)),
        ("expand3x3", (half, inside, 3, 3)),
    )
}


class SqueezeNet(Backbone):
    """Convolutions of SqueezeNet 1.1 (Iandola et al., 2016, arXiv:1602.07360); taps ``relu1``, ``fire2`` to ``fire9``.

    Differs from the source: a picture with a side of less than 17 pixels is widened by repeating its border, so that
    any picture has all activations.

    Args:
        layers: the 25 convolutions, in the order of ``SHAPES``.

    Raises:
        UserError: if the shapes are not those of SqueezeNet 1.1.
    """

    taps = TAPS
    default_taps = ("fire5",)
    least = 17  # the last pooling can take it

    def __init__(self, layers: Layers) -> None:
        super().__init__()
        check_shapes("squeeze", SHAPES, layers)
        first, *rest = layers
        self.first = FrozenConvolution(*first, stride=2, padding=0)
        self.fires = nn.ModuleList(_Fire(rest[i : i + 3]) for i in range(0, len(rest), 3))
        self.normalise = Normalise(IMAGENET_SCALE, IMAGENET_SHIFT)

    def walk(self, pictures: Tensor) -> Iterator[tuple[str, Tensor]]:
        x = self.first(self.normalise(widened(pictures, self.least)))
        x = functional.relu(x, inplace=True)
        yield "relu1", x
        for before, name, fire in zip(TAPS, TAPS[1:], self.fires, strict=False):
            x = fire(functional.max_pool2d(x, 3, 2, ceil_mode=True) if before in POOLED else x)
            yield name, x


class _Fire(nn.Module):
    """Squeeze to few channels, then widen by two convolutions side by side."""

    def __init__(self, layers: Layers) -> None:
        super().__init__()
        self.squeeze, self.narrow, self.wide = (FrozenConvolution(weight, bias) for weight, bias in layers)

    def forward(self, x: Tensor) -> Tensor:
        x = functional.relu(self.squeeze(x), inplace=True)
        return functional.relu(torch.cat([self.narrow(x), self.wide(x)], dim=1), inplace=True)


def load_squeeze(weights: str | None = None, option: str = OPTION) -> SqueezeNet:
    """SqueezeNet 1.1 from a file with torchvision's names (``features.0.weight`` ...), .pth or .safetensors.

    Raises:
        UserError: if no such file is named, or it does not hold SqueezeNet 1.1.
    """
    return SqueezeNet(read_layers("squeeze", weights, SHAPES, option))
