"""How a set of strokes comes to disk: shard by shard, each moved to its place when it is complete.

So at any moment the folder holds only whole shards, which are a smaller set, and what is missing can be made later:
the strokes are the same however often the making was interrupted, and however often the set grew.
"""

from __future__ import annotations

import io
import json
import logging
from collections.abc import Callable
from pathlib import Path
from threading import Event
from typing import Any

import h5py
import numpy as np
import torch
from filelock import FileLock, Timeout
from numpy.typing import NDArray
from torch import Tensor

from brushexp.errors import UserError
from brushexp.plugins.engine.base import Engine, Simulated
from brushexp.strokes.prior import parameters_of, sample_prior
from brushexp.system.files import write_bytes
from brushexp.system.hdf5 import HDF5, fixed
from brushexp.system.progress import counting
from brushexp.system.runtime import interruptible
from brushexp.training.dataset import (
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
SHARD_STROKES = 2048  # of a file; a multiple of BLOCK. Killed at once, a run loses at most so many
BATCH_STROKES = 256  # of a call of the engine
PACKED = {"compression": "gzip", "compression_opts": 1, "shuffle": True, "fletcher32": True}
UNITS = {
    "params": "[-1, 1]: start 2, control 2, end 2 in half-windows; width; RGB",
    "images": "1/255, straight alpha RGBA",
    "heights": f"1/{HEIGHT_STEPS} of the paint that covers the canvas",
}

Rows = dict[str, NDArray[Any]]  # of some strokes, by name of the dataset


class StrokeWriter:
    """A set of strokes on its way to disk; use it in a ``with`` block, which keeps other processes away.

    Args:
        path: folder of the set.
        origin: what makes the strokes.
        seed: of the prior and the engine.
        n: how many strokes it will have.
        wait: wait for another process that makes the same set, instead of stopping.

    Attributes:
        done: strokes that are on disk or simulated.

    Raises:
        UserError: if what is there was made otherwise or is larger, or nothing can be written.
    """

    def __init__(self, path: Path, origin: Origin, seed: int, n: int, *, wait: bool = False) -> None:
        self.path, self.origin, self.seed, self.n, self.done = path, origin, seed, n, 0
        self.lock = FileLock(path / "lock", timeout=-1 if wait else 0)
        self._kept: dict[int, Shard] = {}  # by the number of their first strokes

    def __enter__(self) -> StrokeWriter:
        try:
            self.path.mkdir(parents=True, exist_ok=True)
            self.lock.acquire()
        except Timeout:
            raise UserError(f"{self.path} is being made by another run; wait or choose another path") from None
        except OSError as error:
            reason = f"cannot write {self.path}: {error.strerror}"
            raise UserError(f"{reason}; choose a folder that you may write to with path=...") from error
        try:
            for rest in self.path.glob(".*.h5"):  # of writing that was killed
                rest.unlink()
            self._find_shards()
        except BaseException:
            self.lock.release()
            raise
        return self

    def __exit__(self, *error: object) -> None:
        self.lock.release()

    def simulate(self, engine: Engine) -> None:
        """`fill` with a progress bar, and a way to stop.

        Raises:
            KeyboardInterrupt: after the present batch, when Ctrl-C was pressed.
        """
        pressed = Event()

        def notify(done: int) -> None:
            show(done)
            if pressed.is_set():
                raise KeyboardInterrupt

        with (
            interruptible(pressed.set, "stopping after this batch"),
            counting("simulating strokes", self.n, self.done) as show,
        ):
            self.fill(engine, notify)

    def fill(self, engine: Engine, notify: Callable[[int], None] = lambda done: None) -> None:
        """Simulate what is missing.

        Args:
            engine: what ``origin`` describes.
            notify: told after every batch how many strokes are done; what it raises ends the making, and what is
                simulated by then is kept.
        """
        for first in range(0, self.n, SHARD_STROKES):
            kept, end = self._kept.get(first), min(first + SHARD_STROKES, self.n)
            if kept is not None and len(kept) == end - first:
                continue
            parts = [] if kept is None else [shard_rows(kept)]
            before = sum(len(part["params"]) for part in parts)
            try:
                for start in range(first + before, end, BATCH_STROKES):
                    size = min(BATCH_STROKES, end - start)
                    parameters = parameters_of(sample_prior(size, self.seed, start))
                    parts.append(to_rows(parameters, engine(parameters, seed=self.seed, first=start), start))
                    self.done += size
                    notify(self.done)
            finally:
                if len(parts) > (before > 0):
                    self._write(first, parts)

    def _find_shards(self) -> None:
        """Take account of the whole shards that are there, and make sure that they belong to this set."""
        for path in sorted(self.path.glob("[0-9]*.h5")):
            try:
                shard = Shard(path)
            except UserError as error:
                log.warning("%s; it is made again", str(error).partition(";")[0])
                continue
            theirs, ours = shard.origin.settings() | {"seed": shard.seed}, self.origin.settings() | {"seed": self.seed}
            found = first_difference(theirs, ours)
            if found is not None:
                raise UserError(
                    f"{self.path} was made with {found[0]}, this run has {found[1]}; take the same or another path"
                )
            if shard.first + len(shard) > self.n:
                raise UserError(
                    f"{self.path} has {shard.first + len(shard)} strokes already, more than n={self.n}; "
                    "ask for at least as many or choose another path"
                )
            self._kept[shard.first] = shard
        self.done = sum(map(len, self._kept.values()))

    def _write(self, first: int, parts: list[Rows]) -> None:
        rows = {name: np.concatenate([part[name] for part in parts]) for name in UNITS}
        memory = io.BytesIO()  # h5py does not say why writing to a file failed
        with h5py.File(memory, "w", libver=(HDF5, HDF5)) as file:
            file.attrs.update(
                format=fixed(FORMAT),
                format_version=VERSION,
                first=first,
                n=len(rows["params"]),
                seed=np.uint64(self.seed),
                engine=fixed(self.origin.engine),
                engine_config=fixed(json.dumps(self.origin.engine_config, sort_keys=True)),
                window=self.origin.window,
                splits=fixed(SPLITS),
            )
            for name, value in rows.items():
                row = value.shape[1:]  # the dataset could grow, because others cannot be shorter than a chunk
                layout = {"data": value, "chunks": (BLOCK, *row), "maxshape": (None, *row)}
                file.create_dataset(name, **layout, **PACKED).attrs["unit"] = fixed(UNITS[name])
        write_bytes(self.path / f"{first:09}.h5", memory.getvalue(), key="path")


def shard_rows(shard: Shard) -> Rows:
    """All that a shard holds, as it is on disk."""
    numbers = np.arange(len(shard))
    pictures, heights = shard.rows(shard.images, numbers), shard.rows(shard.heights, numbers)
    return {"params": shard.parameters.numpy(), "images": pictures, "heights": heights}


def to_rows(parameters: Tensor, simulated: Simulated, first: int) -> Rows:
    """What a shard keeps of n strokes.

    Raises:
        UserError: if the engine made something that is not finite.
    """
    images, heights = simulated.images.detach().cpu(), simulated.heights.detach().cpu()
    for value in (images, heights):
        broken = ~value.flatten(1).sum(1).isfinite()  # one pass, and no sum of finite numbers here is infinite
        if broken.any():
            number = first + int(broken.int().argmax())
            raise UserError(f"the engine drew stroke {number} with numbers that are not finite; change its options")
    steps = heights.mul(HEIGHT_STEPS).add(0.5).clamp(0, 2**16 - 1)
    return {
        "params": parameters.float().cpu().numpy(),
        "images": images.clamp(0, 1).mul(255).add(0.5).to(torch.uint8).permute(0, 2, 3, 1).contiguous().numpy(),
        "heights": steps.numpy().astype(np.uint16),
    }
