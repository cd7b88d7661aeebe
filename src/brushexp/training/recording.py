"""How a set of strokes comes to disk: whole or not at all, and from where it stopped when it is killed.

Batches are kept one by one as small files in a folder beside the set's place, each moved there when it is complete;
the last step copies their packed chunks into one file and moves that to its place. So at any moment the folder holds
only good batches, and the set is the same, byte for byte, however often its making was interrupted.
"""

from __future__ import annotations

import io
import json
import logging
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import torch
from filelock import FileLock, Timeout
from numpy.typing import NDArray
from torch import Tensor

from brushexp.errors import UserError
from brushexp.plugins.engine.base import Simulated
from brushexp.system.files import write_bytes, write_text
from brushexp.system.hdf5 import HDF5, fixed
from brushexp.training.dataset import (
    BLOCK,
    FORMAT,
    HEIGHT_STEPS,
    SPLITS,
    VERSION,
    Origin,
    StrokeFile,
    difference,
    unfinished,
)

log = logging.getLogger(__name__)
BATCH = 256  # strokes of a call of the engine and of a file in the folder; a multiple of BLOCK
PACKED = {"compression": "gzip", "compression_opts": 1, "shuffle": True, "fletcher32": True}
UNITS = {
    "params": "[-1, 1]: start 2, control 2, end 2 in half-windows; width; RGB",
    "images": "1/255, straight alpha RGBA",
    "heights": f"1/{HEIGHT_STEPS} of the paint that covers the canvas",
}

Rows = dict[str, NDArray[Any]]


class Recording:
    """A set of strokes on its way to disk; use it in a ``with`` block, which keeps other processes away.

    Args:
        path: where the finished set will be.
        origin: what makes the strokes.
        seed: of the prior and the engine.
        n: how many strokes it will have.

    Attributes:
        done: strokes 0 to ``done - 1`` are safe on disk.
        complete: the set is at its place already.

    Raises:
        UserError: if what is there was made otherwise or is larger, or nothing can be written.
    """

    def __init__(self, path: Path, origin: Origin, seed: int, n: int) -> None:
        self.path, self.origin, self.seed, self.n = path, origin, seed, n
        self.folder = unfinished(path)
        self.before = StrokeFile(path) if path.exists() else None
        if self.before is not None:
            self._agree(self.before.origin.settings() | {"seed": self.before.seed}, path)
            if len(self.before) > n:
                raise UserError(
                    f"{path} has {len(self.before)} strokes already, more than n={n}; "
                    "use it as it is or choose another path"
                )
        self.complete = self.before is not None and len(self.before) == n
        self.kept = 0 if self.before is None else len(self.before) // BATCH * BATCH  # batches of a smaller finished set
        self.done = n if self.complete else self.kept

    def __enter__(self) -> Recording:
        if self.complete:
            shutil.rmtree(self.folder, ignore_errors=True)  # all of it is in the set
            return self
        with mendable(self.path):
            self.folder.mkdir(parents=True, exist_ok=True)
            self.lock = FileLock(self.folder / "lock", timeout=0)
            try:
                self.lock.acquire()
            except Timeout:
                raise UserError(f"{self.path} is being made by another run; wait or choose another path") from None
            try:
                self._open()
            except BaseException:
                self.lock.release()
                raise
        return self

    def _open(self) -> None:
        note = self.folder / "settings.json"
        if note.exists():
            self._agree(json.loads(note.read_text()), self.folder)
        else:
            write_text(note, json.dumps(self.origin.settings() | {"seed": self.seed}))
        for rest in self.folder.glob(".*"):  # of writing that was killed
            rest.unlink()
        last = max((int(path.stem) for path in self.folder.glob("[0-9]*.h5")), default=0)
        if last * BATCH >= self.n:
            raise UserError(
                f"{self.folder} has more than {last * BATCH} strokes already, more than n={self.n}; "
                "ask for at least as many or choose another path"
            )
        while self.done < self.n and self._intact(self.done):
            self.done = min(self.done + BATCH, self.n)

    def __exit__(self, *error: object) -> None:
        if not self.complete:
            self.lock.release()

    def batches(self) -> Iterator[tuple[int, int]]:
        """First number and number of strokes of every batch that is still to be made."""
        for first in range(self.done, self.n, BATCH):
            yield first, min(BATCH, self.n - first)

    def add(self, parameters: Tensor, simulated: Simulated) -> None:
        """Keep the next batch: strokes number ``done`` on."""
        rows = to_rows(parameters, simulated, self.done)
        memory = io.BytesIO()  # h5py does not say why writing to a file failed
        with h5py.File(memory, "w", libver=(HDF5, HDF5)) as file:
            for name, dataset in create(file, len(parameters), self.origin.window).items():
                dataset[...] = rows[name]
        with mendable(self.path):
            write_bytes(self._batch(self.done), memory.getvalue())
        self.done += len(parameters)

    def finish(self) -> None:
        """Put the batches together and move the set to its place, unless it is there."""
        if self.complete:
            return
        whole = self.folder / "whole.h5"
        with mendable(self.path):
            with Patient(whole) as raw, h5py.File(raw, "w", libver=(HDF5, HDF5)) as file:
                describe(file, self.n, self.origin, self.seed)
                datasets = create(file, self.n, self.origin.window)
                for first, part, offset in self._parts():
                    for name, dataset in datasets.items():
                        copy_chunks(part[name], offset, dataset, first, min(BATCH, self.n - first))
            if raw.error is not None:
                whole.unlink()  # the space is needed
                raise raw.error
            os.replace(whole, self.path)
        shutil.rmtree(self.folder, ignore_errors=True)

    def _parts(self) -> Iterator[tuple[int, h5py.File, int]]:
        """Of every batch its first number, the file it is in, and its first row there."""
        for first in range(0, self.n, BATCH):
            if self.before is not None and first < self.kept:
                yield first, self.before.file, first
            else:
                with h5py.File(self._batch(first), "r") as file:
                    yield first, file, 0

    def _batch(self, first: int) -> Path:
        return self.folder / f"{first // BATCH:08}.h5"

    def _intact(self, first: int) -> bool:
        """Whether the batch is there; a shorter one ended a set that is to become larger, and is made again."""
        path = self._batch(first)
        if not path.exists():
            return False
        try:
            with h5py.File(path, "r") as file:
                return {len(file[name]) for name in UNITS} == {min(BATCH, self.n - first)}
        except (OSError, RuntimeError, KeyError) as error:
            log.warning("%s is damaged (%s); it is made again", path, str(error).partition("\n")[0])
            return False

    def _agree(self, theirs: dict[str, object], place: Path) -> None:
        found = difference(theirs, self.origin.settings() | {"seed": self.seed})
        if found is not None:
            raise UserError(f"{place} was made with {found[0]}, this run has {found[1]}; take the same or another path")


@contextmanager
def mendable(path: Path) -> Iterator[None]:
    """Say what a user can do when something could not be written."""
    try:
        yield
    except (OSError, UserError) as error:
        cause = error if isinstance(error, OSError) else error.__cause__
        if not isinstance(cause, OSError):
            raise
        raise UserError(
            f"cannot write {path}: {cause.strerror or cause}; free some space or choose another place with path=..."
        ) from error


class Patient(io.FileIO):
    """A file that keeps its first error instead of raising it: HDF5 cannot be stopped amid writing without harm.

    Attributes:
        error: why something could not be written; the file is then worthless.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path, "w+b")
        self.error: OSError | None = None

    def write(self, data: Any) -> int:
        rest = memoryview(data).cast("B")
        size = len(rest)
        try:
            while rest and self.error is None:
                rest = rest[super().write(rest) :]
        except OSError as error:
            self.error = error
        return size

    def truncate(self, size: int | None = None) -> int:
        try:
            return super().truncate(size)
        except OSError as error:
            self.error = self.error or error
            return size or 0

    def close(self) -> None:
        try:
            if not self.closed and self.error is None:
                os.fsync(self.fileno())
        except OSError as error:
            self.error = error
        super().close()


def to_rows(parameters: Tensor, simulated: Simulated, first: int) -> Rows:
    """What the file keeps of n strokes, by name of the dataset.

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


def create(file: h5py.File, n: int, window: int) -> dict[str, h5py.Dataset]:
    """The three datasets of n strokes, empty; they could grow, because others cannot be shorter than a chunk."""
    shapes: dict[str, tuple[type, tuple[int, ...]]] = {
        "params": (np.float32, (10,)),
        "images": (np.uint8, (window, window, 4)),
        "heights": (np.uint16, (window, window)),
    }
    datasets = {}
    for name, (dtype, row) in shapes.items():
        place = {"shape": (n, *row), "maxshape": (None, *row), "chunks": (BLOCK, *row)}
        datasets[name] = file.create_dataset(name, dtype=dtype, **place, **PACKED)
        datasets[name].attrs["unit"] = fixed(UNITS[name])
    return datasets


def describe(file: h5py.File, n: int, origin: Origin, seed: int) -> None:
    """Write the attributes that make a file a set of strokes."""
    file.attrs.update(
        format=fixed(FORMAT),
        format_version=VERSION,
        n=n,
        seed=np.uint64(seed),
        engine=fixed(origin.engine),
        engine_config=fixed(json.dumps(origin.engine_config, sort_keys=True)),
        window=origin.window,
        splits=fixed(SPLITS),
    )


def copy_chunks(source: h5py.Dataset, start: int, target: h5py.Dataset, first: int, size: int) -> None:
    """Copy ``size`` rows from ``start`` on to rows ``first`` on of another dataset, packed as they are."""
    rest = (0,) * (source.ndim - 1)
    for row in range(0, size, BLOCK):
        mask, packed = source.id.read_direct_chunk((start + row, *rest))
        target.id.write_direct_chunk((first + row, *rest), packed, mask)
