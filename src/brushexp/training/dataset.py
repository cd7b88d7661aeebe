"""``strokes.h5``: what a file of simulated strokes holds, and how it is read; `recording` writes it.

Datasets, n strokes in windows of S x S pixels: ``params`` (n, 10) float32 as `strokes.prior.parameters_of` writes them;
``images`` (n, S, S, 4) uint8 RGBA, straight alpha; ``heights`` (n, S, S) uint16 in units of 1/1024. The stroke in row i
is number i of the prior. Everything is covered by checksums of HDF5; those of pictures are checked when they are read.
Attributes: format, format_version, n, seed, engine, engine_config (JSON), window, splits.

Splits: blocks of 16 strokes, which are also the chunks on disk, go to one split each by their number alone. So a set
keeps its splits when it grows, and reading one split unpacks nothing of another; as strokes are drawn independently,
any rule on the number is fair. With 5 %, a set of 50,000 holds enough test strokes (2500) for an FID of 2048 features.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import torch
from numpy.typing import NDArray
from omegaconf import DictConfig, OmegaConf
from torch import Tensor

from brushexp.errors import UserError
from brushexp.plugins.engine.base import Engine
from brushexp.registry import plugin_of
from brushexp.system.hdf5 import dataset_of, text_of, whole_number_of

FORMAT = "brushexp strokes"
VERSION = 1  # raise it whenever a file of the new kind would mislead an older reader
BLOCK = 16  # strokes of a chunk
PERIOD = 20  # blocks after which the splits repeat
SPLITS = "block = number // 16; block % 20: 0 test, 1 validation, others training"
HEIGHT_STEPS = 1024  # per unit of height: 16 bits reach to 64, and thick paint of the fluid engine to about 8
UNFINISHED = ".partial"  # added to the name of a set that is not finished
FINISH = "finish it with python run.py task=simulate path="

Bytes = NDArray[np.uint8]
Numbers = NDArray[np.int64]


class Split(Enum):
    """What a stroke is for; the values are the rests of the rule in the module's docstring."""

    TEST = 0
    VALIDATION = 1
    TRAINING = 2

    def numbers(self, n: int) -> Numbers:
        """The strokes of this split in a set of n, in order."""
        numbers = np.arange(n, dtype=np.int64)
        return numbers[np.minimum(numbers // BLOCK % PERIOD, Split.TRAINING.value) == self.value]


@dataclass(frozen=True)
class Origin:
    """What made a set of strokes, but for the seed.

    Attributes:
        engine: name of the engine plugin.
        engine_config: all of its options.
        window: pixels on the side of a picture.
    """

    engine: str
    engine_config: dict[str, Any]
    window: int

    def settings(self) -> dict[str, object]:
        """One value for each thing that can differ, as one would type it."""
        options = {f"engine.{key}": value for key, value in sorted(self.engine_config.items())}
        return {"engine": self.engine, **options, "the window": self.window}


def origin_of(node: DictConfig, engine: Engine) -> Origin:
    """Of what an engine simulates that was built from this config node."""
    options = OmegaConf.to_container(node, resolve=True, enum_to_str=True)
    assert isinstance(options, dict)
    config = {str(key): value for key, value in options.items() if not str(key).startswith("_")}
    return Origin(plugin_of(node).name, json.loads(json.dumps(config)), engine.window)


def difference(here: dict[str, object], there: dict[str, object]) -> tuple[str, str] | None:
    """The first setting that differs, as ``key=value`` here and there; None if all are the same."""
    for key in here | there:
        one, other = (f"{key}={side[key]}" if key in side else f"no {key}" for side in (here, there))
        if one != other:
            return one, other
    return None


def require_same_origin(trained: Origin, found: Origin, name: str | Path) -> None:
    """Stop when strokes were made otherwise than those that a renderer was trained on.

    Args:
        trained: what the renderer's training strokes were made with.
        found: what these strokes were made with.
        name: of the file, for the message.

    Raises:
        UserError: names the first difference.
    """
    found_difference = difference(trained.settings(), found.settings())
    if found_difference is not None:
        ours, theirs = found_difference
        raise UserError(
            f"{name} was made with {theirs}, but the renderer was trained on strokes made with {ours}; "
            "give a set made as that one was, or train a renderer on this one"
        )


class StrokeFile:
    """A finished set of strokes; all but the pictures is read and checked at once, pictures when they are asked for.

    Attributes:
        origin: what made it; its parts are also ``engine``, ``engine_config`` and ``window``.
        seed: of the prior and the engine.
        parameters: (n, 10) float32 in [-1, 1].

    Raises:
        UserError: says what is wrong with the file.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        _check_place(path)
        try:
            path.open("rb").close()
            if not h5py.is_hdf5(path):
                raise UserError("not an HDF5 file; give the strokes.h5 of task=simulate")
            self.file = h5py.File(path, "r", rdcc_nbytes=0)  # whole chunks are read, once
            try:
                self._read_head()
            except BaseException:
                self.file.close()
                raise
        except UserError as error:
            raise UserError(f"{path}: {error}") from error
        except (OSError, RuntimeError, ValueError, KeyError, TypeError, OverflowError) as error:  # h5py raises all
            raise self._damaged(error) from error

    def _read_head(self) -> None:
        file = self.file
        if "format" not in file.attrs or text_of(file, "format") != FORMAT:
            raise UserError(f"an HDF5 file, but not one of {FORMAT}; give the strokes.h5 of task=simulate")
        version = whole_number_of(file, "format_version")
        if version != VERSION:
            cure = "update brushexp" if version > VERSION else "simulate it again"
            raise UserError(f"has format_version {version}, and this brushexp reads {VERSION}; {cure}")
        config = text_of(file, "engine_config")
        options = json.loads(config)
        if not isinstance(options, dict):
            raise UserError(f"attribute engine_config is {config}; JSON of the engine's options is needed")
        n, self.window = whole_number_of(file, "n"), whole_number_of(file, "window")
        self.engine: str = text_of(file, "engine")
        self.engine_config: dict[str, Any] = options
        self.origin = Origin(self.engine, options, self.window)
        self.seed: int = whole_number_of(file, "seed")
        if n < 1 or self.window < 1:
            raise UserError(f"n is {n} and window is {self.window}; both must be 1 or more")
        window = self.window
        params = _whole_dataset(file, "params", np.float32, (n, 10))
        self.images = _whole_dataset(file, "images", np.uint8, (n, window, window, 4))
        self._heights = _whole_dataset(file, "heights", np.uint16, (n, window, window))
        self.parameters = torch.from_numpy(params[...])
        if not bool((self.parameters.abs() <= 1).all()):
            raise UserError("params has numbers outside [-1, 1]; it is damaged, simulate it again")

    def __len__(self) -> int:
        return len(self.parameters)

    def close(self) -> None:
        """Let go of the file; else that happens with the last reference to this object."""
        self.file.close()

    def pictures(self, numbers: Numbers) -> Bytes:
        """Images (B, S, S, 4) of these strokes; quickest where many of them share a block.

        Raises:
            UserError: if they are damaged.
        """
        return self._rows(self.images, numbers)

    def heights(self, numbers: Numbers) -> Tensor:
        """Heights (B, S, S) float32 of these strokes; 1 is about what covers the canvas."""
        return torch.from_numpy(self._rows(self._heights, numbers).astype(np.float32) / HEIGHT_STEPS)

    def _rows(self, dataset: h5py.Dataset, numbers: Numbers) -> NDArray[Any]:
        rows = np.empty((len(numbers), *dataset.shape[1:]), dataset.dtype)
        blocks = numbers // BLOCK
        try:
            for block in np.unique(blocks):
                here = np.flatnonzero(blocks == block)
                rows[here] = dataset[block * BLOCK : (block + 1) * BLOCK][numbers[here] - block * BLOCK]
        except (OSError, RuntimeError) as error:
            raise self._damaged(error) from error
        return rows

    def _damaged(self, error: Exception) -> UserError:
        reason = error.strerror if isinstance(error, OSError) and error.strerror else str(error).partition("\n")[0]
        return UserError(f"{self.path} is damaged or cut short ({reason}); simulate it again or give another one")


def unfinished(path: Path) -> Path:
    """The folder in which the set at ``path`` grows until it is complete."""
    return path.with_name(path.name + UNFINISHED)


def _check_place(path: Path) -> None:
    whole = path.with_name(path.name.removesuffix(UNFINISHED))
    if not path.is_file() and unfinished(whole).is_dir():
        raise UserError(f"{whole} is not finished; {FINISH}{whole} and the options that it was begun with")
    if path.is_dir():
        raise UserError(f"{path} is a folder; give the file in it, {path / 'strokes.h5'}")
    if not path.exists():
        raise UserError(f"there is no file {path}; make one with python run.py task=simulate path={path}")


def _whole_dataset(file: h5py.File, name: str, dtype: type, shape: tuple[int, ...]) -> h5py.Dataset:
    """The dataset, if it is what the format says and every chunk of it was written; its numbers are not read yet."""
    dataset = dataset_of(file, name, dtype, shape)
    if dataset.chunks is None or dataset.chunks[0] != BLOCK:
        raise UserError(f"{name} has chunks {dataset.chunks}; {BLOCK} strokes in each are needed")
    if dataset.id.get_num_chunks() != -(-shape[0] // BLOCK):
        raise UserError(f"{name} has only {dataset.id.get_num_chunks()} of its chunks; it is not complete")
    return dataset
