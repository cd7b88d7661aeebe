"""Batches of strokes for training: shuffled from files without holding them in memory, or simulated on the way."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import NamedTuple

import lightning as L
import numpy as np
import torch
from torch import Tensor

from brushexp.errors import UserError
from brushexp.plugins.engine.base import Engine
from brushexp.strokes.prior import parameters_of, sample_prior
from brushexp.training.dataset import BLOCK, Bytes, Numbers, Origin, Split, StrokeSet

GROUP = 32  # blocks whose strokes are shuffled together
HELD_OUT = {Split.VALIDATION: 2**40, Split.TEST: 2**41}  # first number of those simulated on the way


class StrokeBatch(NamedTuple):
    """Strokes and their pictures.

    Attributes:
        parameters: (B, 10) float32 in [-1, 1], as `strokes.prior.parameters_of` writes them.
        images: (B, 4, S, S) float32 in [0, 1], RGBA, straight alpha.
        number: (B,) int64 number of each stroke, which decides its split.
    """

    parameters: Tensor
    images: Tensor
    number: Tensor


@dataclass(frozen=True)
class EngineSource:
    """An engine that simulates strokes when they are needed, in training never the same twice.

    Attributes:
        engine: simulates them.
        origin: what the engine is, `dataset.origin_of`.
        seed: of the prior and the engine.
        steps: batches that are called an epoch.
        held_out: strokes for validation, and as many for the test.
    """

    engine: Engine
    origin: Origin
    seed: int = 0
    steps: int = 500
    held_out: int = 1000

    def batch(self, first: int, size: int) -> StrokeBatch:
        """Strokes number ``first`` to ``first + size - 1``."""
        parameters = parameters_of(sample_prior(size, self.seed, first))
        images = self.engine(parameters, seed=self.seed, first=first).images
        return StrokeBatch(parameters, images, torch.arange(first, first + size))


class StrokeLoader:
    """Batches of one split, epoch after epoch, in an order that the epoch's number decides.

    Args:
        batches: those of an epoch, from one on: (epoch, first batch) -> iterator.
        length: batches of an epoch.
        prefetch: how many a thread makes ahead; 0 makes them when they are asked for.
    """

    def __init__(self, batches: Callable[[int, int], Iterator[StrokeBatch]], length: int, prefetch: int) -> None:
        self.batches, self.length, self.prefetch = batches, length, prefetch
        self.position = self.next = (0, 0)  # epoch, batch

    def __len__(self) -> int:
        return self.length

    def __iter__(self) -> Iterator[StrokeBatch]:
        epoch, first = self.next
        self.position, self.next = (epoch, first), (epoch + 1, 0)
        for batch in prefetched(self.batches(epoch, first), self.prefetch):
            self.position = (epoch, self.position[1] + 1)
            yield batch

    def set_epoch(self, epoch: int) -> None:
        """Let the next iteration be this epoch; else it is the one after the last."""
        self.next = (epoch, 0)

    def state_dict(self) -> dict[str, int]:
        """How far it is; Lightning puts this into its checkpoints."""
        return {"epoch": self.position[0], "batch": self.position[1]}

    def load_state_dict(self, state: dict[str, int]) -> None:
        """Go on after the last batch that was handed out."""
        epoch, batch = state["epoch"], state["batch"]
        self.next = self.position = (epoch, batch) if batch < self.length else (epoch + 1, 0)


class StrokeData(L.LightningDataModule):
    """Training, validation and test strokes from files, or from an engine.

    Every training stroke comes once in an epoch, in an order decided by seed and epoch; the others come in order.
    The last batch of an epoch may be smaller.

    Args:
        source: sets of `task=simulate`, all of one engine and window; or `EngineSource`.
        batch_size: strokes of a batch.
        seed: of the order.
        limit: use only the first so many training strokes; None uses all.
        prefetch: batches that a thread makes ahead, from sets; None makes 8 where there is a GPU, and none where the
            processor trains: there the thread takes from the training what it gives.

    Attributes:
        origin: what made the strokes (of several sets, the first).
        sets: the opened sets; none of `EngineSource`.

    Raises:
        UserError: if a set cannot be read, the sets do not fit together, or a split is empty.
    """

    def __init__(
        self,
        source: Sequence[Path] | EngineSource,
        *,
        batch_size: int = 64,
        seed: int = 0,
        limit: int | None = None,
        prefetch: int | None = None,
    ) -> None:
        super().__init__()
        self.source = source
        self.batch_size, self.seed = batch_size, seed
        self.prefetch = (8 if torch.cuda.is_available() else 0) if prefetch is None else prefetch
        self.sets: list[StrokeSet] = []
        if isinstance(source, EngineSource):
            self.origin = source.origin
            self._simulations: dict[Split, StrokeBatch] = {}
            if limit is not None:
                raise UserError(f"limit={limit} is for sets, and these strokes are simulated on the way; drop limit")
            return
        self.sets = [StrokeSet(path) for path in source]
        require_compatible(self.sets)
        self.origin = self.sets[0].origin
        self._places = {split: places_of(split, self.sets) for split in Split}
        self._places[Split.TRAINING] = self._places[Split.TRAINING][:limit]
        for split, found in self._places.items():
            if not len(found):
                raise UserError(
                    f"{', '.join(map(str, source))}: no stroke is for {split.name.lower()} "
                    f"(limit={limit}); simulate more than {2 * BLOCK} strokes, and set limit to 1 or more"
                )

    def train_dataloader(self) -> StrokeLoader:
        if isinstance(self.source, EngineSource):
            return StrokeLoader(partial(self._simulated, self.source), self.source.steps, 0)
        return StrokeLoader(self._shuffled, -(-len(self._places[Split.TRAINING]) // self.batch_size), self.prefetch)

    def val_dataloader(self) -> StrokeLoader:
        return self._held_out(Split.VALIDATION)

    def test_dataloader(self) -> StrokeLoader:
        return self._held_out(Split.TEST)

    def count(self, split: Split, wanted: int | None) -> int:
        """Held-out strokes of a split: as many as wanted, and there."""
        there = self.source.held_out if isinstance(self.source, EngineSource) else len(self._places[split])
        return min(there, wanted or there)

    def first(self, split: Split, n: int) -> Iterator[StrokeBatch]:
        """The first n held-out strokes of a split."""
        for batch in self._held_out(split):
            if n <= 0:
                break
            yield StrokeBatch(*(values[:n] for values in batch))
            n -= len(batch.number)

    def first_batch(self, split: Split, n: int) -> StrokeBatch:
        """The same in one batch."""
        return StrokeBatch(*map(torch.cat, zip(*self.first(split, n), strict=True)))

    def _held_out(self, split: Split) -> StrokeLoader:
        if isinstance(self.source, EngineSource):
            batches, n, prefetch = partial(self._kept, self.source, split), self.source.held_out, 0
        else:
            batches, n, prefetch = partial(self._in_order, split), len(self._places[split]), self.prefetch
        return StrokeLoader(batches, -(-n // self.batch_size), prefetch)

    def _shuffled(self, epoch: int, first: int) -> Iterator[StrokeBatch]:
        """Training batches: blocks in random order, their strokes mixed among those of `GROUP` blocks."""
        skip = first * self.batch_size
        found = np.empty((0, 2), np.int64)  # what is read and not handed out yet
        images = self._pictures(found)
        for group in shuffled_groups(self._places[Split.TRAINING], np.random.default_rng([self.seed, epoch])):
            wanted, skip = group[skip:], max(0, skip - len(group))
            if not len(wanted):
                continue
            found = np.concatenate([found, wanted])
            images = np.concatenate([images, self._pictures(wanted)])
            while len(found) >= self.batch_size:
                yield self._batch(found[: self.batch_size], images[: self.batch_size])
                found, images = found[self.batch_size :], images[self.batch_size :]
        if len(found):
            yield self._batch(found, images)

    def _in_order(self, split: Split, _epoch: int, first: int) -> Iterator[StrokeBatch]:
        found = self._places[split]
        for start in range(first * self.batch_size, len(found), self.batch_size):
            wanted = found[start : start + self.batch_size]
            yield self._batch(wanted, self._pictures(wanted))

    def _pictures(self, wanted: Numbers) -> Bytes:
        window = self.origin.window
        images = np.empty((len(wanted), window, window, 4), np.uint8)
        for k, strokes in enumerate(self.sets):
            here = wanted[:, 0] == k
            images[here] = strokes.pictures(wanted[here, 1])
        return images

    def _batch(self, wanted: Numbers, images: Bytes) -> StrokeBatch:
        parameters = torch.empty(len(wanted), 10)
        numbers = torch.from_numpy(wanted[:, 1].copy())
        for k, strokes in enumerate(self.sets):
            here = torch.from_numpy(wanted[:, 0] == k)
            parameters[here] = strokes.parameters[numbers[here]]
        planes = np.empty((len(images), 4, *images.shape[1:3]), np.float32)
        np.divide(images.transpose(0, 3, 1, 2), np.float32(255), out=planes)  # not torch: a thread of its own would
        return StrokeBatch(parameters, torch.from_numpy(planes), numbers)  # start as many again

    def _simulated(self, source: EngineSource, epoch: int, first: int) -> Iterator[StrokeBatch]:
        for k in range(epoch * source.steps + first, (epoch + 1) * source.steps):
            yield source.batch(k * self.batch_size, self.batch_size)

    def _kept(self, source: EngineSource, split: Split, _epoch: int, first: int) -> Iterator[StrokeBatch]:
        """Held-out strokes, simulated once and then kept."""
        if split not in self._simulations:
            self._simulations[split] = source.batch(HELD_OUT[split], source.held_out)
        for parts in list(zip(*(part.split(self.batch_size) for part in self._simulations[split]), strict=True))[
            first:
        ]:
            yield StrokeBatch(*parts)


def require_compatible(sets: list[StrokeSet]) -> None:
    """Stop unless the sets are of one engine and window, and none repeats another.

    Raises:
        UserError: names the first difference.
    """
    if not sets:
        raise UserError("no set of strokes is given; give one, made with python run.py task=simulate")
    for k, found in enumerate(sets[1:], 1):
        for name in ("engine", "window"):
            ours, theirs = getattr(sets[0].origin, name), getattr(found.origin, name)
            if ours != theirs:
                raise UserError(
                    f"{sets[0].path} has {name} {ours}, and {found.path} has {name} {theirs}; give sets that agree"
                )
        for other in sets[:k]:
            if (other.origin, other.seed) == (found.origin, found.seed):
                raise UserError(
                    f"{other.path} and {found.path} hold the same strokes (seed {found.seed}); "
                    "drop one, or simulate it again with another seed"
                )


def places_of(split: Split, sets: list[StrokeSet]) -> Numbers:
    """Set and number (n, 2) of all strokes of a split, in order."""
    rows = [split.numbers(len(found)) for found in sets]
    return np.concatenate([np.stack([np.full_like(row, k), row], axis=1) for k, row in enumerate(rows)])


def shuffled_groups(found: Numbers, random: np.random.Generator) -> list[Numbers]:
    """Places (n, 2), in order, as groups of whole blocks; blocks and the places in a group in random order."""
    blocks = found // (1, BLOCK)
    starts = 1 + np.flatnonzero((blocks[1:] != blocks[:-1]).any(axis=1))
    parts = np.split(found, starts)
    order = random.permutation(len(parts))
    groups = (order[k : k + GROUP] for k in range(0, len(order), GROUP))
    return [random.permutation(np.concatenate([parts[k] for k in group])) for group in groups]


def prefetched(items: Iterator[StrokeBatch], depth: int) -> Iterator[StrokeBatch]:
    """The same items, of which a thread makes up to ``depth`` before they are asked for."""
    if depth == 0:
        yield from items
        return
    with ThreadPoolExecutor(1) as pool:
        waiting = deque(pool.submit(next, items, None) for _ in range(depth))
        try:
            while (item := waiting.popleft().result()) is not None:
                waiting.append(pool.submit(next, items, None))
                yield item
        finally:
            pool.shutdown(wait=True, cancel_futures=True)
