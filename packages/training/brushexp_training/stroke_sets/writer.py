"""Write a set of strokes shard by shard; each shard is moved into the set's folder when it is complete.

The folder therefore always holds a valid, though possibly smaller, set, and its final strokes do not depend on how
often the simulation is interrupted.
"""

import io
import json
import logging
from contextlib import AbstractContextManager
from pathlib import Path
from threading import Event
from typing import Any

import h5py
import numpy as np
import torch
from filelock import FileLock, Timeout
from numpy.typing import NDArray
from torch import Tensor

from brushexp.contracts import UserError
from brushexp.contracts.families import Engine, Simulated
from brushexp.contracts.files import HDF5, TEMPORARY, counting, encode_fixed, write_bytes
from brushexp.contracts.machine import interruptible
from brushexp.contracts.strokes import parameters_of, sample_prior
from brushexp_training.stroke_sets.dataset import (
    BLOCK,
    FORMAT,
    HEIGHT_STEPS,
    SPLITS,
    VERSION,
    Origin,
    Shard,
    first_difference,
)

log = logging.getLogger(__name__)
SHARD_STROKES = 2048  # strokes per file, a multiple of BLOCK; a killed run loses at most this many
BATCH_STROKES = 256  # strokes per call of the engine
PACKED = {"compression": "gzip", "compression_opts": 1, "shuffle": True, "fletcher32": True}
UNITS = {
    "params": "[-1, 1]: start 2, control 2, end 2 in half-windows; width; RGB",
    "images": "1/255, straight alpha RGBA",
    "heights": f"1/{HEIGHT_STEPS} of the paint that covers the canvas",
}

BYTES_PER_PIXEL = 12  # memory for the strokes of a file: RGBA and height, in parts and joined

Rows = dict[str, NDArray[Any]]  # arrays of some strokes by name of the dataset


def simulate_set(path: Path, engine: Engine, origin: Origin, seed: int, n: int, *, wait: bool = False) -> int:
    """Simulate the missing strokes of a set of ``n`` strokes, with a progress bar, and return their number.

    If ``wait`` is true, wait for another process that is simulating the same set instead of raising an error. Raises
    UserError if the set is larger or has other settings. Ctrl-C stops after the current batch and keeps all simulated
    strokes.
    """
    with _lock(path, wait):
        for rest in path.glob(TEMPORARY):  # left by a killed process
            rest.unlink()
        shards = whole_shards(path, origin, seed, n)
        done = sum(map(len, shards.values()))
        if done:
            log.info("%s already has %d of %d strokes%s", path, done, n, "; continuing" if done < n else "")
        _simulate_missing(path, engine, origin, seed, n, shards)
    return n - done


def _simulate_missing(path: Path, engine: Engine, origin: Origin, seed: int, n: int, shards: dict[int, Shard]) -> None:
    """Write the shards that are missing or incomplete; keep all simulated strokes after Ctrl-C or an error."""
    pressed, done = Event(), sum(map(len, shards.values()))
    with interruptible(pressed.set, "stopping after this batch"), counting("simulating strokes", n, done) as show:
        for first in range(0, n, SHARD_STROKES):
            start, end = first + len(shards.get(first, ())), min(first + SHARD_STROKES, n)
            parts = [shard_rows(shards[first])] if first < start < end else []
            try:
                for number in range(start, end, BATCH_STROKES):
                    parameters = parameters_of(sample_prior(min(BATCH_STROKES, end - number), seed, number))
                    parts.append(to_rows(parameters, engine(parameters, seed=seed, first=number), number))
                    done += len(parameters)
                    show(done)
                    if pressed.is_set():
                        raise KeyboardInterrupt
            finally:
                if len(parts) > (start > first):
                    _write(path, parts, first, origin, seed)


def _lock(path: Path, wait: bool) -> AbstractContextManager[object]:
    try:
        path.mkdir(parents=True, exist_ok=True)
        return FileLock(path / "lock", timeout=-1 if wait else 0).acquire()
    except Timeout:
        raise UserError(f"{path} is being made by another run; wait or choose another path") from None
    except OSError as error:
        reason = f"cannot write {path}: {error.strerror}"
        raise UserError(f"{reason}; choose a folder that you may write to with path=...") from error


def whole_shards(path: Path, origin: Origin, seed: int, n: int) -> dict[int, Shard]:
    """Open the valid shards in a folder, and return them keyed by the number of their first stroke.

    Raises UserError if a shard does not belong to this set.
    """
    shards = {}
    for file in sorted(path.glob("[0-9]*.h5")):
        try:
            shard = Shard(file)
        except UserError as error:
            log.warning("%s; it is simulated again", str(error).partition(";")[0])
            continue
        theirs, ours = shard.origin.settings() | {"seed": shard.seed}, origin.settings() | {"seed": seed}
        if difference := first_difference(theirs, ours):
            raise UserError(
                f"{path} was made with {difference[0]}, this run has {difference[1]}; use the same or another path"
            )
        if (end := shard.first + len(shard)) > n:
            raise UserError(
                f"{path} has {end} strokes already, more than n={n}; ask for at least as many or choose another path"
            )
        shards[shard.first] = shard
    return shards


def _write(path: Path, parts: list[Rows], first: int, origin: Origin, seed: int) -> None:
    rows = {name: np.concatenate([part[name] for part in parts]) for name in UNITS}
    memory = io.BytesIO()  # h5py does not report why writing to a file failed
    with h5py.File(memory, "w", libver=(HDF5, HDF5)) as file:
        file.attrs.update(
            format=encode_fixed(FORMAT),
            format_version=VERSION,
            first=first,
            n=len(rows["params"]),
            seed=np.uint64(seed),
            engine=encode_fixed(origin.engine),
            engine_config=encode_fixed(json.dumps(origin.engine_config, sort_keys=True)),
            window=origin.window,
            splits=encode_fixed(SPLITS),
        )
        for name, value in rows.items():
            row = value.shape[1:]  # resizable, because fixed datasets cannot be shorter than a chunk
            layout = {"data": value, "chunks": (BLOCK, *row), "maxshape": (None, *row)}
            file.create_dataset(name, **layout, **PACKED).attrs["unit"] = encode_fixed(UNITS[name])
    write_bytes(path / f"{first:09}.h5", memory.getvalue(), key="path")


def shard_rows(shard: Shard) -> Rows:
    """Read all rows of a shard."""
    numbers = np.arange(len(shard))
    pictures, heights = shard.rows(shard.images, numbers), shard.rows(shard.heights, numbers)
    return {"params": shard.parameters.numpy(), "images": pictures, "heights": heights}


def to_rows(parameters: Tensor, simulated: Simulated, first: int) -> Rows:
    """Convert simulated strokes to rows of a shard; raise UserError if the engine's output is not finite."""
    images, heights = simulated.images.detach().cpu(), simulated.heights.detach().cpu()
    for value in (images, heights):
        broken = ~value.flatten(1).sum(1).isfinite()  # needs one pass; sums of finite numbers here are finite
        if broken.any():
            number = first + int(broken.int().argmax())
            raise UserError(f"the engine drew stroke {number} with numbers that are not finite; change its options")
    steps = heights.mul(HEIGHT_STEPS).add(0.5).clamp(0, 2**16 - 1)
    return {
        "params": parameters.float().cpu().numpy(),
        "images": images.clamp(0, 1).mul(255).add(0.5).to(torch.uint8).permute(0, 2, 3, 1).contiguous().numpy(),
        "heights": steps.numpy().astype(np.uint16),
    }
