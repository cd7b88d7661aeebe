"""AlexNet, the smallest of the classic networks, from weights that the user has."""

from collections.abc import Iterator

from torch import Tensor, nn
from torch.nn import functional

from brushexp.features.base import Backbone, FrozenConvolution, Normalise, widened
from brushexp.features.weights import IMAGENET_SCALE, IMAGENET_SHIFT, OPTION, Layers, check_shapes, read_layers

# Of each convolution: its place in torchvision's `features`, its shape, stride and padding.
LAYERS = (
    (0, (64, 3, 11, 11), 4, 2),
    (3, (192, 64, 5, 5), 1, 2),
    (6, (384, 192, 3, 3), 1, 1),
    (8, (256, 384, 3, 3), 1, 1),
    (10, (256, 256, 3, 3), 1, 1),
)
POOLED = ("relu1", "relu2")  # what is pooled, 3 x 3 by 2


class AlexNet(Backbone):
    """Convolutions of torchvision's AlexNet (Krizhevsky, 2014, arXiv:1404.5997); taps ``relu1`` to ``relu5``.

    Differs from the source: a picture with a side of less than 31 pixels is widened by repeating its border, so that
    any picture has all activations.

    Args:
        layers: the 5 convolutions.

    Raises:
        UserError: if the shapes are not those of AlexNet.
    """

    taps = tuple(f"relu{i}" for i in range(1, 6))
    default_taps = ("relu3",)
    least = 31  # leaves one position at the end
    context = 64

    def __init__(self, layers: Layers) -> None:
        super().__init__()
        check_shapes("alexnet", {f"features.{place}": shape for place, shape, _, _ in LAYERS}, layers)
        self.layers = nn.ModuleList(
            FrozenConvolution(weight, bias, stride=stride, padding=padding)
            for (weight, bias), (_, _, stride, padding) in zip(layers, LAYERS, strict=True)
        )
        self.normalise = Normalise(IMAGENET_SCALE, IMAGENET_SHIFT)

    def walk(self, pictures: Tensor) -> Iterator[tuple[str, Tensor]]:
        x = self.normalise(widened(pictures, self.least))
        for name, layer in zip(self.taps, self.layers, strict=True):
            x = functional.relu(layer(x), inplace=True)
            yield name, x
            if name in POOLED:
                x = functional.max_pool2d(x, 3, 2)


def load_alexnet(weights: str | None = None, option: str = OPTION) -> AlexNet:
    """AlexNet from a file with torchvision's names (``features.0.weight`` ...), .pth or .safetensors.

    Raises:
        UserError: if no such file is named, or it does not hold AlexNet.
    """
    return AlexNet(read_layers("alexnet", weights, [f"features.{place}" for place, *_ in LAYERS], option))
