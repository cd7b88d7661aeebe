"""AlexNet, SqueezeNet 1.1 and VGG16 with torchvision's layer numbering and weights from the user's file."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from textwrap import shorten

import torch
from torch import Tensor, nn
from torch.nn import functional

from brushexp.contracts import UserError
from brushexp.contracts.pictures import Backbone

MEAN, DEVIATION = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)  # ImageNet's, as torchvision trains its networks
VGG_DEPTHS = (2, 2, 3, 3, 3)  # convolutions per block


class Fire(nn.Module):
    """SqueezeNet block that reduces the channels, then expands them with two parallel convolutions."""

    def __init__(self, before: int, inside: int, half: int) -> None:
        super().__init__()
        self.squeeze = nn.Conv2d(before, inside, 1)
        self.expand1x1 = nn.Conv2d(inside, half, 1)
        self.expand3x3 = nn.Conv2d(inside, half, 3, padding=1)

    def forward(self, x: Tensor) -> Tensor:
        x = self.squeeze(x).relu_()
        return torch.cat([self.expand1x1(x), self.expand3x3(x)], dim=1).relu_()


def _alexnet() -> Iterator[nn.Module]:
    yield from (nn.Conv2d(3, 64, 11, 4, 2), nn.ReLU(inplace=True), nn.MaxPool2d(3, 2))
    yield from (nn.Conv2d(64, 192, 5, padding=2), nn.ReLU(inplace=True), nn.MaxPool2d(3, 2))
    for before, after in pairwise((192, 384, 256, 256)):
        yield from (nn.Conv2d(before, after, 3, padding=1), nn.ReLU(inplace=True))


def _squeezenet() -> Iterator[nn.Module]:
    pool = nn.MaxPool2d(3, 2, ceil_mode=True)
    yield from (nn.Conv2d(3, 64, 3, 2), nn.ReLU(inplace=True), pool, Fire(64, 16, 64), Fire(128, 16, 64))
    yield from (pool, Fire(128, 32, 128), Fire(256, 32, 128))
    yield from (pool, Fire(256, 48, 192), Fire(384, 48, 192), Fire(384, 64, 256), Fire(512, 64, 256))


def _vgg16() -> Iterator[nn.Module]:
    before = 3
    for depth, channels in zip(VGG_DEPTHS, (64, 128, 256, 512, 512), strict=True):
        for _ in range(depth):
            yield from (nn.Conv2d(before, channels, 3, padding=1), nn.ReLU(inplace=True))
            before = channels
        yield nn.MaxPool2d(2)


@dataclass(frozen=True)
class Architecture:
    """A network as a sequence of layers, with the names of its activations."""

    layers: Callable[[], Iterator[nn.Module]]
    taps: tuple[str, ...]  # names of the activations after rectifiers and "fire" modules
    default_tap: str  # activation best suited to a content loss
    least: int  # shortest side in pixels that yields all activations; smaller pictures are padded at their border
    context: int = 32  # see `Backbone`


ARCHITECTURES = {
    # Krizhevsky, 2014, arXiv:1404.5997
    "alexnet": Architecture(_alexnet, tuple(f"relu{i}" for i in range(1, 6)), "relu3", least=31, context=64),
    # SqueezeNet 1.1, Iandola et al., 2016, arXiv:1602.07360
    "squeeze": Architecture(_squeezenet, ("relu1", *(f"fire{i}" for i in range(2, 10))), "fire5", least=17),
    # Simonyan and Zisserman, 2015, arXiv:1409.1556
    "vgg16": Architecture(
        _vgg16,
        tuple(f"relu{block}_{i}" for block, depth in enumerate(VGG_DEPTHS, 1) for i in range(1, depth + 1)),
        "relu4_3",
        least=16,
    ),
}


class ClassicNetwork(Backbone):
    """A network from ``ARCHITECTURES``, with weights under torchvision's names (``features.0.weight`` ...).

    Raises UserError if ``state`` lacks any of these weights; other entries, such as a classifier's, are ignored.
    """

    mean: Tensor
    deviation: Tensor

    def __init__(self, name: str, state: dict[str, Tensor]) -> None:
        super().__init__()
        chosen = ARCHITECTURES[name]
        self.taps, self.default_taps = chosen.taps, (chosen.default_tap,)
        self.least, self.context = chosen.least, chosen.context
        with torch.device("meta"):  # allocate nothing before the file's weights are assigned
            self.features = nn.Sequential(*chosen.layers())
        try:
            self.load_state_dict({key: state[key] for key in state if key.startswith("features.")}, assign=True)
        except RuntimeError as error:
            reason = shorten(str(error).partition("\n")[2], 200)
            raise UserError(f"weights: {reason}; name a file with torchvision's {name}") from error
        for module in self.features.modules():
            for part, value in [*module.named_parameters(recurse=False)]:
                delattr(module, part)
                module.register_buffer(part, value.detach(), persistent=False)
        for part, numbers in (("mean", MEAN), ("deviation", DEVIATION)):
            self.register_buffer(part, torch.tensor(numbers).reshape(3, 1, 1), persistent=False)

    def walk(self, pictures: Tensor) -> Iterator[tuple[str, Tensor]]:
        height, width = pictures.shape[-2:]
        down, across = max(self.least - height, 0), max(self.least - width, 0)
        padding = (across // 2, across - across // 2, down // 2, down - down // 2)
        x = functional.pad(pictures, padding, mode="replicate") if down or across else pictures
        x = (x.to(self.mean.dtype) - self.mean) / self.deviation
        taps = iter(self.taps)
        for layer in self.features:
            x = layer(x)
            if isinstance(layer, nn.ReLU | Fire):
                yield next(taps), x
