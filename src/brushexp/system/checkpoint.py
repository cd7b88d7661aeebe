"""Write and read trained weights, ``<name>.safetensors``, and their recipe, ``<name>.json``, in the same folder.

docs/formats.md lists the keys of the recipe. Nothing in either file is ever executed.
"""

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from brushexp.errors import UserError
from brushexp.system.files import write_bytes, write_json
from brushexp.system.reading import check_format_version, check_plain, json_of, read_text, shorten_value
from brushexp.system.reading_tensors import read_safetensors

VERSION = 1  # version of the format; increase it if new files would mislead older readers
PROGRAM = "brushexp "  # first word of every format


@dataclass(frozen=True)
class CheckpointFormat:
    """A type of checkpoint: where to find it, and how messages name it."""

    noun: str  # name of the network in messages, "renderer"
    family: str  # family of its plugins, as in the recipe
    key: str  # key that names the checkpoint, "renderer.checkpoint", next to the plugin's other options
    task: str  # task that trains it, as typed
    without: str  # meaning of null in its place; "" if a checkpoint is required
    folders: Callable[[], Sequence[Path]]  # folders of shipped checkpoints, including those of packages

    def restore(self, module: nn.Module, name: str, checkpoint: str | None, options: Mapping[str, Any]) -> str:
        """Load trained weights into a plugin's module in ``eval`` mode; call this at the end of ``__init__``.

        Returns the hash of the weights; if ``checkpoint`` is None, loads no weights and returns "". Raises a UserError
        if ``options`` differ from the recipe, or if a file is missing, damaged or for another plugin.
        """
        module.eval()
        if checkpoint is None:
            return ""
        path, where = self.path_of(checkpoint), f"{self.key}={checkpoint}"
        recipe = self.read_recipe(path)
        family, trained = recipe[self.family], recipe["options"]
        if family != name:
            raise UserError(f"{where} is for {self.family}={shorten_value(family)}, not for {name}; change one of them")
        for key, value in plain_options(options).items():
            typed = f"{self.key.rpartition('.')[0]}.{key}"
            if key not in trained:
                raise UserError(f"{where} was trained before {typed} existed; train it again with {self.task}")
            if trained[key] != value:
                typed += "=" + shorten_value(json.dumps(trained[key]).strip('"'))
                raise UserError(f"{where} was trained with {typed}, not {value}; set {typed}")
        try:
            module.load_state_dict(read_safetensors(path, "pickle files are refused, because they can run code"))
        except RuntimeError as error:
            cure = f"train it again with {self.task}"
            raise UserError(f"{where} belongs to another {self.noun}; {cure}: {shorten_value(error)}") from error
        if weights_hash(module) != recipe["hash"]:
            raise UserError(f"{path.with_suffix('.json')} describes other weights; copy both files of the checkpoint")
        return str(recipe["hash"])

    def save(self, path: Path, name: str, module: nn.Module, recipe: Mapping[str, Any], *, half: bool = True) -> str:
        """Write a module's weights to ``path`` (.safetensors), and the recipe to a file beside it.

        The recipe needs ``options`` and may have ``data``, ``training`` and ``figures``. With ``half``, floats are
        stored in 16 bits unless they overflow; the module's own weights are rounded in the same way. Returns the hash
        of the weights.
        """
        from safetensors.torch import save  # noqa: PLC0415  (--help needs none of it)

        path = path.with_suffix(".safetensors")
        stored = {key: _compact(value, half) for key, value in module.state_dict().items()}
        with torch.no_grad():
            for key, value in module.state_dict().items():
                value.copy_(stored[key])
        digest = weights_hash(module)
        head = {"format": PROGRAM + self.noun, "format_version": VERSION, self.family: name, "hash": digest}
        write_bytes(path, save(stored))
        write_json(path.with_suffix(".json"), {**head, **recipe, "options": plain_options(recipe["options"])})
        return digest

    def path_of(self, checkpoint: str) -> Path:
        """Return the .safetensors file of a checkpoint, which is a path or the name of a shipped checkpoint."""
        is_name = Path(checkpoint).name == checkpoint and not Path(checkpoint).suffix
        shipped = {file.stem: file for folder in self.folders() for file in folder.glob("*.safetensors")}
        path = shipped.get(checkpoint, Path()) if is_name else Path(checkpoint)
        if path.is_file():
            return path
        where = f"{self.key}={checkpoint}"
        if not is_name:
            raise UserError(f"{where}: there is no such file; give the .safetensors file of {self.task}")
        names = ", ".join(sorted(shipped)) or "none"
        cure = "give the path of a .safetensors file" + f", or null for {self.without}" * bool(self.without)
        raise UserError(f"{where} is not a shipped checkpoint (there are: {names}); {cure}")

    def shipped_name(self, name: str) -> str | None:
        """Return ``name`` if a shipped checkpoint has that name, otherwise None."""
        return name if any((folder / f"{name}.safetensors").is_file() for folder in self.folders()) else None

    def read_recipe(self, path: Path) -> dict[str, Any]:
        """Read the recipe of the checkpoint at ``path``; raise a UserError if the recipe is missing or invalid."""
        file, cure = path.with_suffix(".json"), "copy it again from the source of the checkpoint"
        if not file.is_file():
            raise UserError(f"{path} has no recipe beside it; also copy {file.name} there")
        text = read_text(file, cure)
        try:
            recipe = check_plain(json_of(text))
        except UserError as error:
            raise UserError(f"{file} is {error}; {cure}") from error
        if not isinstance(recipe, dict) or recipe.get("format") != PROGRAM + self.noun:
            raise UserError(f"{file} is not the recipe of a {self.noun}; give the checkpoint that {self.task} wrote")
        try:
            check_format_version(recipe.get("format_version"), VERSION)
        except UserError as error:
            raise UserError(f"{file} {error}") from error
        for key, kind in ((self.family, str), ("options", dict), ("hash", str)):
            if not isinstance(recipe.get(key), kind):
                raise UserError(f"{file} has no {key}; {cure}")
        return recipe


def weights_hash(module: nn.Module) -> str:
    """Compute the SHA-256 of all names, shapes and weights (floats as float32); "" for a module without weights."""
    state = module.state_dict()
    if not state:
        return ""
    digest = hashlib.sha256()
    for name, value in sorted(state.items()):
        number = (value.float() if value.is_floating_point() else value.long()).detach().cpu().contiguous().numpy()
        digest.update(f"{name} {tuple(value.shape)}\n".encode())
        digest.update(number.astype(number.dtype.newbyteorder("<")).tobytes())
    return digest.hexdigest()


def plain_options(options: Mapping[str, Any]) -> dict[str, Any]:
    """Convert options to JSON values (an `Enum` to its name), except ``checkpoint`` and names that start with ``_``."""
    chosen = {key: value for key, value in options.items() if key != "checkpoint" and not key.startswith("_")}
    plain: dict[str, Any] = json.loads(json.dumps(chosen, default=lambda choice: choice.name))
    return plain


def _compact(value: Tensor, half: bool) -> Tensor:
    value = value.detach().cpu().contiguous().clone()
    short = value.half() if half and value.is_floating_point() else value
    return short if bool(short.isfinite().all()) else value
