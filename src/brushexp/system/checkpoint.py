"""Trained weights on disk: ``<name>.safetensors`` and, beside it, ``<name>.json``, the recipe that made them.

The recipe is what is needed to build the module again and to know what it can do: the family and name of the plugin,
``options`` (those of the plugin that the weights depend on), ``data`` (what it learned from), ``training`` (settings),
``figures`` (how good it is), ``hash`` of the weights, ``format`` and ``format_version``. Nothing in either file is ever
run.
"""

import hashlib
import json
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from brushexp.errors import UserError
from brushexp.system.files import write_bytes, write_json

VERSION = 1  # raise it whenever a file of the new kind would mislead an older reader
PROGRAM = "brushexp "  # how every format begins


@dataclass(frozen=True)
class CheckpointFormat:
    """What a checkpoint is of, and how users speak of it.

    Attributes:
        noun: what it is, "renderer".
        family: that of its plugins, under which the recipe keeps the plugin's name.
        node: where the plugin's options are in the config, "renderer".
        task: what trains it, as one would type it.
        without: what ``checkpoint=null`` means.
        shipped: folder of those that come with the program.
    """

    noun: str
    family: str
    node: str
    task: str
    without: str
    shipped: Path

    @property
    def format(self) -> str:
        """The recipe's mark."""
        return PROGRAM + self.noun

    def restore(self, module: nn.Module, name: str, checkpoint: str | None, options: Mapping[str, Any]) -> str:
        """Put trained weights into a module and set it to ``eval``; call it at the end of ``__init__``.

        Args:
            module: with all of its parameters and buffers made.
            name: of the plugin in the registry.
            checkpoint: path of a .safetensors file, or the plain name of a checkpoint that comes with the program; None
                leaves the weights as they are.
            options: those options that the weights depend on, by name (an `Enum` counts by its name); everything that
                is not the same in the recipe is refused.

        Returns:
            the hash of the weights, "" without a checkpoint.

        Raises:
            UserError: if the file is missing, unsafe, damaged, or of another plugin or other options; it says what to
                type instead.
        """
        module.eval()
        if checkpoint is None:
            return ""
        path = self.path_of(checkpoint)
        recipe = self.read_recipe(path)
        where = f"{self.node}.checkpoint={checkpoint}"
        family = self.family
        if recipe[family] != name:
            raise UserError(f"{where} is of {family}={recipe[family]}, not of {name}; set the one or the other")
        trained = recipe["options"]
        for key, value in plain_options(options).items():
            typed = f"{self.node}.{key}"
            if key not in trained:
                raise UserError(f"{where} was trained before there was {typed}; train it again with {self.task}")
            if trained[key] != value:
                typed += "=" + json.dumps(trained[key]).strip('"')
                raise UserError(f"{where} was trained with {typed}, not {value}; set {typed}")
        self._load(module, read_weights(path), where)
        found = weights_hash(module)
        if found != recipe["hash"]:
            raise UserError(f"{path.with_suffix('.json')} describes other weights; copy both files of a checkpoint")
        return found

    def save(self, path: Path, name: str, module: nn.Module, recipe: Mapping[str, Any], *, half: bool = True) -> str:
        """Write ``path`` (.safetensors) and the recipe beside it; the module then holds the weights as written.

        Args:
            path: where to; a suffix other than .safetensors is replaced.
            name: of the plugin in the registry.
            module: its weights: every parameter and every buffer that `state_dict` names.
            recipe: ``options`` and, as far as they are known, ``data``, ``training`` and ``figures``.
            half: store 16-bit floats, half the bytes; numbers that do not fit into them stay 32-bit.

        Returns:
            the hash of the weights.

        Raises:
            UserError: if the files cannot be written.
        """
        from safetensors.torch import save  # noqa: PLC0415  (--help needs none of it)

        path = path.with_suffix(".safetensors")
        stored = {key: _stored(value, half) for key, value in module.state_dict().items()}
        with torch.no_grad():
            for key, value in module.state_dict().items():
                value.copy_(stored[key])
        digest = weights_hash(module)
        head = {"format": self.format, "format_version": VERSION, self.family: name, "hash": digest}
        write_bytes(path, save(stored))
        write_json(path.with_suffix(".json"), {**head, **recipe, "options": plain_options(recipe["options"])})
        return digest

    def path_of(self, checkpoint: str) -> Path:
        """The .safetensors file: a plain name is one that comes with the program, anything else is a path."""
        plain = Path(checkpoint).name == checkpoint and not Path(checkpoint).suffix
        path = self.shipped / f"{checkpoint}.safetensors" if plain else Path(checkpoint)
        if path.is_file():
            return path
        where = f"{self.node}.checkpoint={checkpoint}"
        if plain:
            names = ", ".join(sorted(file.stem for file in self.shipped.glob("*.safetensors"))) or "none"
            raise UserError(
                f"{where} does not come with the program (there are: {names}); "
                f"give the path of a .safetensors file, or null for {self.without}"
            )
        raise UserError(f"{where}: there is no such file; give the .safetensors of {self.task}")

    def shipped_name(self, name: str) -> str | None:
        """The name again if a checkpoint of that name comes with the program, else None."""
        return name if (self.shipped / f"{name}.safetensors").is_file() else None

    def read_recipe(self, path: Path) -> dict[str, Any]:
        """The recipe of the checkpoint at ``path`` (.safetensors).

        Raises:
            UserError: if there is none, or it is not one.
        """
        file = path.with_suffix(".json")
        if not file.is_file():
            raise UserError(f"{path} has no recipe beside it; copy {file.name} there too")
        try:
            recipe = json.loads(file.read_text())
        except (ValueError, UnicodeDecodeError) as error:
            raise UserError(
                f"{file} is not JSON ({error}); copy it again from where the checkpoint came from"
            ) from error
        found = recipe.get("format") if isinstance(recipe, dict) else None
        if not isinstance(recipe, dict) or found != self.format:
            other = f" but of a {str(found).removeprefix(PROGRAM)}" if str(found).startswith(PROGRAM) else ""
            raise UserError(
                f"{file} is not the recipe of a {self.noun}{other}; give the checkpoint that {self.task} wrote"
            )
        if recipe.get("format_version") != VERSION:
            raise UserError(
                f"{file} has format_version {recipe.get('format_version')}, and this brushexp reads {VERSION}; "
                "update brushexp or train again"
            )
        kinds = {self.family: str, "options": dict, "hash": str}
        wrong = [key for key, kind in kinds.items() if not isinstance(recipe.get(key), kind)]
        if wrong:
            raise UserError(f"{file} has no {wrong[0]}; copy it again from where the checkpoint came from")
        return recipe

    def _load(self, module: nn.Module, tensors: Mapping[str, Tensor], where: str) -> None:
        """Copy the tensors in, after all names and shapes were found to fit."""
        wanted = module.state_dict()
        odd = sorted(wanted.keys() ^ tensors.keys())
        if odd:
            raise UserError(
                f"{where} {'has no' if odd[0] in wanted else 'also has a'} tensor {odd[0]}, so it is of another "
                f"version of this {self.noun}; train it again with {self.task}"
            )
        for name, value in wanted.items():
            if value.shape != tensors[name].shape:
                raise UserError(
                    f"{where}: {name} has shape {tuple(tensors[name].shape)}, this {self.noun} needs "
                    f"{tuple(value.shape)}; give a checkpoint of this {self.noun} with the same options"
                )
            if not bool(tensors[name].isfinite().all()):
                raise UserError(f"{where}: {name} has numbers that are not finite; train it again")
        module.load_state_dict(dict(tensors))


def read_weights(path: Path) -> dict[str, Tensor]:
    """Tensors of a .safetensors file, by name; floats as 32 bit.

    Raises:
        UserError: if it is a pickle, or damaged.
    """
    from safetensors import SafetensorError  # noqa: PLC0415  (--help needs none of it)
    from safetensors.torch import load  # noqa: PLC0415

    data = path.read_bytes()
    pickled = data[:1] == b"\x80" or zipfile.is_zipfile(path)  # torch.save, old and new
    if (
        pickled and data[8:9] != b"{"
    ):  # there begins the head of a .safetensors, after its length, which may look so too
        raise UserError(f"{path} is a pickle, which can run code; give the .safetensors file of task=train")
    try:
        tensors = load(data)
    except (SafetensorError, ValueError, KeyError) as error:
        raise UserError(f"{path} is damaged or no .safetensors file ({error}); copy it again or train again") from error
    return {name: value.float() if value.is_floating_point() else value for name, value in tensors.items()}


def weights_hash(module: nn.Module) -> str:
    """SHA-256 of all weights, names and shapes (as 32-bit floats); "" for a module that has none."""
    state = module.state_dict()
    if not state:
        return ""
    digest = hashlib.sha256()
    for name, value in sorted(state.items()):
        number = value.detach().cpu()
        number = number.float() if number.is_floating_point() else number.long()
        digest.update(f"{name} {tuple(value.shape)}\n".encode())
        digest.update(number.contiguous().numpy().astype(number.numpy().dtype.newbyteorder("<")).tobytes())
    return digest.hexdigest()


def plain_options(options: Mapping[str, Any]) -> dict[str, Any]:
    """Options as JSON keeps them: an `Enum` by its name, tuples as lists; without those that are not of the weights."""
    named = {key: value.name if isinstance(value, Enum) else value for key, value in options.items()}
    kept = {key: value for key, value in named.items() if key != "checkpoint" and not key.startswith("_")}
    plain: dict[str, Any] = json.loads(json.dumps(kept))
    return plain


def _stored(value: Tensor, half: bool) -> Tensor:
    """As it is written: on the CPU, contiguous, 16-bit where that is asked for and the numbers fit."""
    value = value.detach().cpu().contiguous().clone()
    if not (half and value.is_floating_point()):
        return value
    short = value.half()
    return short if bool(short.isfinite().all()) else value
