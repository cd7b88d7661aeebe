"""Files of weights: where pip packages keep them, and how they are read without running any code."""

from importlib.util import find_spec
from pathlib import Path

import torch
from torch import Tensor

from brushexp.errors import UserError

OPTION = "loss.perceptual.weights"  # what an error tells a user to set, if nobody says otherwise


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
        return dict(torch.load(path, weights_only=True, map_location="cpu", mmap=True))
    except Exception as error:  # pickle, zip and safetensors have a dozen kinds
        raise UserError(
            f"weights: {path} holds no table of tensors ({type(error).__name__}); name a .pth or .safetensors file"
        ) from error
