"""Provide crops of paintings that are generated while the network learns from them."""

import os
import subprocess
import sys
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from itertools import count, islice
from pathlib import Path

import lightning as L
import numpy as np
from brushexp_training.stroke_sets.datamodule import EPOCH_STEPS, StrokeLoader

from brushexp.contracts import UserError
from brushexp_recovery.synthesis.paintings import KnownPainting
from brushexp_recovery.synthesis.pool import is_made, load_painting, path_of
from brushexp_recovery.train.crops import Crops, batch_of, cut_crop

FIRST_PAINTINGS = 8  # number of paintings that must exist before training begins
AHEAD = 1  # number of batches cut in advance
RELOAD_STEPS = 20  # number of steps between checks for new paintings
FIRST_HELD_OUT = 900_000  # number of the first held-out painting
HELD_OUT_COUNT = 56
VALIDATED = 6  # number of the first held-out paintings, which are used for validation
VALIDATION_CROPS = 4  # crops per validation painting
PAINTINGS = "[0-9]*.npz"  # pattern of files in the pool's folder
WAIT = 0.5  # seconds between checks for paintings that do not exist yet


class RecoveryData(L.LightningDataModule):
    """Crops from a pool of paintings that separate processes keep filling.

    Painting k is determined by the seed, k and its paint family; the crops of a step depend on the seed, the step and
    the paintings that exist by then.
    """

    def __init__(
        self,
        folder: Path,
        pictures: Sequence[str],
        seed: int,
        batch_size: int,
        paintings: int,
        painters: int,
        families: Iterable[str] = (),
    ) -> None:
        """Use paintings of ``pictures`` with numbers below ``paintings``, made by ``painters`` parallel processes.

        If ``families`` are given, about half of all paintings have a paint family; of these, only the paintings of the
        given families are made and used. Otherwise no painting has a family.
        """
        super().__init__()
        self.families = frozenset(families)
        self.folder, self.pictures, self.seed = folder, list(pictures), seed
        self.batch_size, self.paintings, self.painters = batch_size, paintings, painters
        self.processes: list[subprocess.Popen[bytes]] = []
        self.loaded: dict[Path, KnownPainting] = {}
        held_out = (number for number in count(FIRST_HELD_OUT) if is_made(seed, number, self.families))
        self.held_out_numbers = list(islice(held_out, HELD_OUT_COUNT))

    def setup(self, stage: str) -> None:
        if stage == "fit":
            self.start_painting()
            self._wait(self._training_paths, min(FIRST_PAINTINGS, self.paintings))

    def teardown(self, stage: str) -> None:
        for process in self.processes:
            process.terminate()
        self.processes = []

    def start_painting(self) -> None:
        """Start separate processes that make the missing paintings."""
        command = [sys.executable, "-m", "brushexp_recovery.synthesis.pool"]
        command += [str(os.getpid()), str(self.folder), str(self.seed)]  # it watches this process by its number
        command.append(",".join(sorted(self.families)))
        held_out = range(FIRST_HELD_OUT, self.held_out_numbers[-1] + 1)
        parts = [range(first, self.paintings, self.painters) for first in range(self.painters)]
        for numbers in (held_out, *parts):
            words = [str(numbers.start), str(numbers.stop), str(numbers.step), *self.pictures]
            self.processes.append(subprocess.Popen([*command, *words], start_new_session=True))

    def train_dataloader(self) -> StrokeLoader:
        return StrokeLoader(self._batches, EPOCH_STEPS)

    def val_dataloader(self) -> StrokeLoader:
        return StrokeLoader(lambda _epoch, _first: self._validation_batches(), VALIDATED)

    def held_out_paintings(self, end: int, first: int = 0) -> list[KnownPainting]:
        """Return the held-out paintings from ``first`` to ``end - 1``, waiting until they exist."""
        self._wait(self._held_out_paths, end)
        return [load_painting(path) for path in self._held_out_paths()[first:end]]

    def batch(self, step: int) -> Crops:
        """Cut the crops for one training step."""
        if step % RELOAD_STEPS == 0 or not self.loaded:
            self.loaded |= {path: load_painting(path) for path in self._training_paths() if path not in self.loaded}
        random = np.random.default_rng([self.seed, step])
        chosen = random.integers(len(self.loaded), size=self.batch_size)
        paintings = list(self.loaded.values())
        return batch_of([cut_crop(paintings[number], random) for number in chosen])

    def _validation_batches(self) -> Iterator[Crops]:
        random = np.random.default_rng(self.seed)
        for painting in self.held_out_paintings(VALIDATED):
            yield batch_of([cut_crop(painting, random) for _ in range(VALIDATION_CROPS)])

    def _batches(self, epoch: int, first: int) -> Iterator[Crops]:
        """Cut each batch in a separate thread while the network learns from the previous one."""
        with ThreadPoolExecutor(1) as cutter:
            steps = range(epoch * EPOCH_STEPS + first, (epoch + 1) * EPOCH_STEPS)
            waiting = deque[Future[Crops]]()
            for step in steps:
                waiting.append(cutter.submit(self.batch, step))
                if len(waiting) > AHEAD:
                    yield waiting.popleft().result()
            while waiting:
                yield waiting.popleft().result()

    def _training_paths(self) -> list[Path]:
        most = min(self.paintings, FIRST_HELD_OUT)
        numbers = {path: int(path.stem.partition("-")[0]) for path in sorted(self.folder.glob(PAINTINGS))}
        return [path for path, number in numbers.items() if number < most and self._has(path, number)]

    def _held_out_paths(self) -> list[Path]:
        paths = [path_of(self.folder, self.seed, number, self.families) for number in self.held_out_numbers]
        return [path for path in paths if path.is_file()]

    def _has(self, path: Path, number: int) -> bool:
        """Check whether a file holds painting ``number`` of this pool rather than of a pool with other families."""
        is_own = path == path_of(self.folder, self.seed, number, self.families)
        return is_own and is_made(self.seed, number, self.families)

    def _wait(self, paths: Callable[[], list[Path]], count: int) -> None:
        """Wait until ``count`` paintings exist; raise UserError if no process is making them any more."""
        while len(paths()) < count:
            if self.processes and all(process.poll() is not None for process in self.processes):
                raise UserError("no paintings can be made for training; the error is reported above")
            time.sleep(WAIT)
