"""Read a set of simulated strokes, which is a folder of shards (HDF5 files, docs/formats.md), block by block.

Blocks of 16 strokes are the chunks on disk; a block's number alone determines its split. A set therefore keeps its
splits when it grows, and reading one split does not decompress any blocks of the others. With 5 % of the strokes for
testing, a set of 50,000 has enough test strokes (2500) for an FID with 2048 features.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import torch
from numpy.typing import NDArray
from omegaconf import DictConfig, OmegaConf

from brushexp.contracts import UserError, plugin_of
from brushexp.contracts.families import Engine
from brushexp.contracts.files import (
    check_chunk,
    check_format_version,
    dataset_of,
    explaining,
    json_of,
    numbers_of,
    open_hdf5,
    shorten_value,
    text_of,
    whole_number_of,
)

FORMAT = "brushexp strokes"
VERSION = 2  # version of the format; increase it whenever new files would mislead older readers
BLOCK = 16  # strokes per chunk
PERIOD = 20  # number of blocks after which the splits repeat
SPLITS = "block = number // 16; block % 20: 0 test, 1 validation, others training"
MOST_STROKES = 2**20  # maximum number per shard; the writer makes shards much smaller
CURE = "simulate it again or give another one"
HEIGHT_STEPS = 1024  # steps per unit of height; 16 bits reach up to 64, thick paint of the fluid engine about 8

Bytes = NDArray[np.uint8]
Numbers = NDArray[np.int64]


class Split(Enum):
    """The part of a set that a stroke belongs to; the value is the block number modulo `PERIOD`, clipped at 2."""

    TEST = 0
    VALIDATION = 1
    TRAINING = 2

    def places(self, numbers: Numbers) -> Numbers:
        """Return the indices of this split's strokes in ``numbers``, in ascending order."""
        return np.flatnonzero(np.minimum(numbers // BLOCK % PERIOD, Split.TRAINING.value) == self.value)


@dataclass(frozen=True)
class Origin:
    """The engine, engine options and window that were used to simulate a set of strokes.

    The seed is stored separately.
    """

    engine: str  # name of the plugin
    engine_config: dict[str, Any]  # all of its options
    window: int  # pixels on the side of a picture

    def settings(self) -> dict[str, object]:
        """Return the settings in which sets can differ, as a mapping from names to values."""
        options = {f"engine.{key}": value for key, value in sorted(self.engine_config.items())}
        return {"engine": self.engine, **options, "the window": self.window}


def origin_of(node: DictConfig, engine: Engine) -> Origin:
    """Return the origin of the strokes that ``engine`` simulates, given the config node that it was built from."""
    options = OmegaConf.to_container(node, resolve=True, enum_to_str=True)
    assert isinstance(options, dict)
    config = {str(key): value for key, value in options.items() if not str(key).startswith("_")}
    return Origin(plugin_of(node).name, json.loads(json.dumps(config)), engine.window)


def first_difference(first: dict[str, object], second: dict[str, object]) -> tuple[str, str] | None:
    """Return the first setting that differs between two origins, as ``key=value`` for each, or None if they agree."""
    for key in first | second:
        one, other = (f"{key}={side[key]}" if key in side else f"no {key}" for side in (first, second))
        if one != other:
            return one, other
    return None


class Shard:
    """One file of a set, starting with the set's stroke number ``first``; pictures are read and checked on demand."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.file = open_hdf5(path, "give a set of task=simulate", rdcc_nbytes=0)  # whole chunks are read only once
        try:
            with explaining(path, CURE):
                self._read_head()
        except BaseException:
            self.file.close()
            raise

    def _read_head(self) -> None:
        file = self.file
        if "format" not in file.attrs or text_of(file, "format") != FORMAT:
            raise UserError(f"an HDF5 file, but not one of {FORMAT}; give a set of task=simulate")
        version = whole_number_of(file, "format_version")
        if version < VERSION:
            raise UserError(f"has format_version {version}, and this brushexp reads {VERSION}; simulate it again")
        check_format_version(version, VERSION)
        config = text_of(file, "engine_config")
        try:
            options = json_of(config)
        except UserError as error:
            raise UserError(f"attribute engine_config is {error}; {CURE}") from error
        if not isinstance(options, dict):
            raise UserError(f"attribute engine_config is {shorten_value(config)}, not JSON of the engine's options")
        self.first, n, window, self.seed = (whole_number_of(file, name) for name in ("first", "n", "window", "seed"))
        self.origin = Origin(text_of(file, "engine"), options, window)
        if self.first < 0 or not 1 <= n <= MOST_STROKES or window < 1:
            least = f"minimum 0, 1 and 1, maximum {MOST_STROKES} strokes"
            raise UserError(f"first is {self.first}, n is {n} and window is {window} ({least})")
        params = _whole_dataset(file, "params", np.float32, (n, 10))
        self.images = _whole_dataset(file, "images", np.uint8, (n, window, window, 4))
        self.heights = _whole_dataset(file, "heights", np.uint16, (n, window, window))
        self.parameters = torch.from_numpy(numbers_of(params))
        self._checked: set[tuple[str, int]] = set()  # blocks that have been read
        if not bool((self.parameters.abs() <= 1).all()):
            raise UserError("params has numbers outside [-1, 1]; it is damaged, simulate it again")

    def __len__(self) -> int:
        return len(self.parameters)

    def rows(self, dataset: h5py.Dataset, rows: Numbers) -> NDArray[Any]:
        """Read rows of ``images`` or ``heights``, each block only once; raise UserError if a block is damaged."""
        values = np.empty((len(rows), *dataset.shape[1:]), dataset.dtype)
        blocks = rows // BLOCK
        with explaining(self.path, CURE):
            for block in np.unique(blocks):
                if (dataset.name, block) not in self._checked:
                    check_chunk(dataset, (int(block) * BLOCK, *(0 for _ in dataset.shape[1:])))
                    self._checked.add((dataset.name, block))
                within = np.flatnonzero(blocks == block)
                values[within] = dataset[block * BLOCK : (block + 1) * BLOCK][rows[within] - block * BLOCK]
        return values


class StrokeSet:
    """All shards of a set, in a folder or a single file; invalid shards raise UserError."""

    def __init__(self, path: Path) -> None:
        self.path = path
        paths = sorted(path.glob("[0-9]*.h5")) if path.is_dir() else [path]
        if not paths or not paths[0].is_file():
            cure = f"make one with brushexp task=simulate path={path}"
            raise UserError(f"there is no set of strokes at {path}; {cure}")
        self.shards = [Shard(file) for file in paths]
        self.origin, self.seed = self.shards[0].origin, self.shards[0].seed
        count = 0
        for shard in self.shards:
            if shard.first != count:
                raise UserError(
                    f"{shard.path} begins at stroke {shard.first}, but only {count} strokes are before it; "
                    "give the folder of the whole set, and simulate the missing strokes again"
                )
            count += len(shard)
            if (shard.origin, shard.seed) != (self.origin, self.seed):
                raise UserError(f"{shard.path} belongs to a different set than {paths[0]}; separate their folders")

    def __len__(self) -> int:
        return sum(map(len, self.shards))


def pictures_of(shards: Sequence[Shard], places: Numbers) -> Bytes:
    """Read the images (n, S, S, 4) of the strokes at the indices ``places``, which continue from shard to shard."""
    starts = np.cumsum([0, *map(len, shards)])
    owner = np.searchsorted(starts, places, side="right") - 1
    pictures = np.empty((len(places), *shards[0].images.shape[1:]), np.uint8)
    for k in np.unique(owner):
        pictures[owner == k] = shards[k].rows(shards[k].images, places[owner == k] - starts[k])
    return pictures


def _whole_dataset(file: h5py.File, name: str, dtype: type, shape: tuple[int, ...]) -> h5py.Dataset:
    """Open a dataset, and check that all of its chunks exist, without reading its values."""
    dataset = dataset_of(file, name, dtype, shape)
    if dataset.chunks is None or dataset.chunks[0] != BLOCK:
        raise UserError(f"{name} has chunks {dataset.chunks}, not of {BLOCK} strokes")
    wanted, there = -(-shape[0] // BLOCK), dataset.id.get_num_chunks()
    if there != wanted:
        raise UserError(f"{name} has only {there} of its {wanted} chunks")
    return dataset
