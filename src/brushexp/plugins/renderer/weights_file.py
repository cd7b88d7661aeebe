"""Weights of renderers on disk, see `brushexp.system.checkpoint`."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from torch import nn

from brushexp.system.checkpoint import Kind

RENDERERS = Kind(
    noun="renderer",
    family="renderer",
    node="renderer",
    task="task=train",
    without="weights that are not trained",
    shipped=Path(__file__).parent / "weights",
)


def restore(module: nn.Module, renderer: str, checkpoint: str | None, options: Mapping[str, Any]) -> str:
    """Put trained weights into a renderer and set it to painting, see `Kind.restore`."""
    return RENDERERS.restore(module, renderer, checkpoint, options)


def save_checkpoint(
    path: Path, renderer: str, module: nn.Module, recipe: Mapping[str, Any], *, half: bool = True
) -> str:
    """Write the weights of a renderer and their recipe, see `Kind.save`."""
    return RENDERERS.save(path, renderer, module, recipe, half=half)


def shipped(name: str) -> str | None:
    """The name again if a checkpoint of that name comes with the program, else None."""
    return name if (RENDERERS.shipped / f"{name}.safetensors").is_file() else None


def checkpoint_path(checkpoint: str) -> Path:
    """The .safetensors file of a plain name or a path, see `Kind.path_of`."""
    return RENDERERS.path_of(checkpoint)


def read_recipe(path: Path) -> dict[str, Any]:
    """The recipe of the renderer at ``path`` (.safetensors), see `Kind.read_recipe`."""
    return RENDERERS.read_recipe(path)
