"""Files of weights: where pip packages keep them, and how they are read without running any code."""

from collections.abc import Iterable, Mapping
from importlib.util import find_spec
from pathlib import Path

import torch
from torch import Tensor

from brushexp.errors import UserError

Layers = list[tuple[Tensor, Tensor]]  # weight (O, I, K, K) and bias (O,) of each convolution

OPTION = "loss.perceptual.weights"  # what an error tells a user to set, if nobody says otherwise
MEAN, DEVIATION = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)  # of ImageNet, as torchvision trains its networks
IMAGENET_SCALE = tuple(1 / d for d in DEVIATION)  # what they multiply pictures in [0, 1] by
IMAGENET_SHIFT = tuple(-m / d for m, d in zip(MEAN, DEVIATION, strict=True))  # and add then


def packaged(package: str, file: str) -> Path | None:
    """Path of a file in an installed package, whose code is not run; None without the package."""
    spec = find_spec(package)
    folders = spec.submodule_search_locations if spec else None
    return Path(folders[0]) / file if folders else None


def read_tensors(path: Path) -> dict[str, Tensor]:
    """Tensors of a .pth or .safetensors file, by name.

    Raises:
        UserError: if there is no such file, or it holds something else.
    """
    if not path.is_file():
        raise UserError(f"weights: there is no file {path}; name one that exists")
    try:
        if path.suffix == ".safetensors":
            from safetensors.torch import load_file  # noqa: PLC0415  (only this format needs it)

            return load_file(path)
        return dict(torch.load(path, weights_only=True, map_location="cpu"))
    except Exception as error:  # pickle, zip and safetensors have a dozen kinds
        raise UserError(
            f"weights: {path} holds no table of tensors ({type(error).__name__}); name a .pth or .safetensors file"
        ) from error


def read_layers(backbone: str, weights: str | None, names: Iterable[str], option: str) -> Layers:
    """Convolutions called ``names`` of a .pth or .safetensors file with torchvision's names.

    Raises:
        UserError: if no file is named, or it lacks one of them.
    """
    if weights is None:
        raise UserError(
            f"backbone {backbone} needs a file with torchvision's weights; set {option}=path, "
            f"or take another network: {option.replace('weights', 'backbone')}=effl0"
        )
    state = read_tensors(Path(weights))
    try:
        return [(state[f"{name}.weight"], state[f"{name}.bias"]) for name in names]
    except KeyError as error:
        raise UserError(
            f"weights: {weights} has no tensor {error}; "
            f"name a file with torchvision's {backbone} (features.0.weight ...)"
        ) from error


def check_shapes(backbone: str, shapes: Mapping[str, tuple[int, ...]], layers: Layers) -> None:
    """Refuse convolutions that do not have the ``shapes`` (O, I, K, K), by name.

    Raises:
        UserError: with the first that has another.
    """
    for (name, shape), (weight, bias) in zip(shapes.items(), layers, strict=True):
        if weight.shape != shape or bias.shape != shape[:1]:
            raise UserError(
                f"weights: {name}.weight has shape {tuple(weight.shape)}, that of {backbone} {shape}; "
                f"name a file with torchvision's {backbone}"
            )
