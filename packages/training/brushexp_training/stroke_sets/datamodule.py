"""Read batches of strokes in random order without loading all strokes into memory, or simulate them on demand."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from itertools import combinations
from pathlib import Path
from typing import Any, NamedTuple

import lightning as L
import numpy as np
import torch
from torch import Tensor

from brushexp.contracts import UserError
from brushexp.contracts.families import Engine
from brushexp.contracts.strokes import parameters_of, sample_prior
from brushexp_training.stroke_sets.dataset import BLOCK, Bytes, Numbers, Origin, Split, StrokeSet, pictures_of

GROUP = 32  # number of blocks whose strokes are shuffled together
EPOCH_STEPS = 500  # number of batches per epoch if strokes never repeat
HELD_OUT = {Split.VALIDATION: 2**40, Split.TEST: 2**41}  # number of the first stroke simulated on demand


class StrokeBatch(NamedTuple):
    """A batch of strokes and their pictures; a stroke's number determines its split."""

    parameters: Tensor  # (B, 10) float32 in [-1, 1], encoded like `strokes.prior.parameters_of`
    images: Tensor  # (B, 4, S, S) float32 in [0, 1], RGBA, straight alpha
    number: Tensor  # (B,) int64


class StrokeLoader:
    """Loader whose iterators each yield one epoch of ``length`` batches, from ``batches(epoch, first batch)``."""

    def __init__(self, batches: Callable[[int, int], Iterator[Any]], length: int) -> None:
        self.batches, self.length = batches, length
        self.position = self.next = (0, 0)  # epoch, batch

    def __len__(self) -> int:
        return self.length

    def __iter__(self) -> Iterator[Any]:
        epoch, first = self.next
        self.position, self.next = (epoch, first), (epoch + 1, 0)
        for batch in self.batches(epoch, first):
            self.position = (epoch, self.position[1] + 1)
            yield batch

    def state_dict(self) -> dict[str, int]:
        return {"epoch": self.position[0], "batch": self.position[1]}

    def load_state_dict(self, state: dict[str, int]) -> None:
        """Make the next iteration start after the last batch that was yielded."""
        epoch, batch = state["epoch"], state["batch"]
        self.next = self.position = (epoch, batch) if batch < self.length else (epoch + 1, 0)


class StrokeData(L.LightningDataModule, ABC):
    """Base class for data modules of training, validation and test strokes; an epoch's last batch may be smaller."""

    origin: Origin  # origin of the strokes, or of the first of several sets
    sets: Sequence[StrokeSet] = ()  # opened sets; empty if strokes are simulated on demand
    batch_size: int
    seed: int  # seed of the strokes if they are simulated on demand, otherwise of their order

    @property
    def first_seed(self) -> int:
        """The seed of the strokes, or of the first set if there are several."""
        return self.sets[0].seed if self.sets else self.seed

    @abstractmethod
    def size(self, split: Split) -> int:
        """Return the number of strokes in a split or, for training, in an epoch."""

    @abstractmethod
    def batches(self, split: Split, epoch: int, first: int) -> Iterator[StrokeBatch]:
        """Yield an epoch's batches, starting with batch number ``first``; only training strokes are shuffled."""

    def train_dataloader(self) -> StrokeLoader:
        return self._loader(Split.TRAINING)

    def val_dataloader(self) -> StrokeLoader:
        return self._loader(Split.VALIDATION)

    def test_dataloader(self) -> StrokeLoader:
        return self._loader(Split.TEST)

    def count(self, split: Split, most: int | None) -> int:
        """Return the number of strokes in a split, or ``most`` if that is smaller."""
        return min(self.size(split), most or self.size(split))

    def first(self, split: Split, n: int) -> Iterator[StrokeBatch]:
        """Yield the first ``n`` held-out strokes of a split in batches."""
        for batch in self._loader(split):
            if n <= 0:
                break
            yield StrokeBatch(*(values[:n] for values in batch))
            n -= len(batch.number)

    def first_batch(self, split: Split, n: int) -> StrokeBatch:
        """Return the first ``n`` held-out strokes of a split as one batch."""
        return StrokeBatch(*map(torch.cat, zip(*self.first(split, n), strict=True)))

    def _loader(self, split: Split) -> StrokeLoader:
        return StrokeLoader(partial(self.batches, split), -(-self.size(split) // self.batch_size))


class SimulatedData(StrokeData):
    """Data module that simulates strokes on demand, with ``held_out`` strokes each for validation and testing.

    Training strokes never repeat.
    """

    def __init__(
        self, engine: Engine, origin: Origin, *, batch_size: int = 64, seed: int = 0, held_out: int = 1000
    ) -> None:
        super().__init__()
        self.engine, self.origin, self.batch_size, self.seed, self.held_out = engine, origin, batch_size, seed, held_out
        self._held_out: dict[int, StrokeBatch] = {}  # held-out strokes, which every validation uses

    def size(self, split: Split) -> int:
        return EPOCH_STEPS * self.batch_size if split is Split.TRAINING else self.held_out

    def batches(self, split: Split, epoch: int, first: int) -> Iterator[StrokeBatch]:
        size = self.size(split)
        begin = HELD_OUT.get(split, epoch * size)
        for number in range(begin + first * self.batch_size, begin + size, self.batch_size):
            if (batch := self._held_out.get(number)) is None:
                numbers = torch.arange(number, min(number + self.batch_size, begin + size))
                parameters = parameters_of(sample_prior(len(numbers), self.seed, number))
                images = self.engine(parameters, seed=self.seed, first=number).images
                batch = StrokeBatch(parameters, images, numbers)
            if split is not Split.TRAINING:
                self._held_out[number] = batch
            yield batch


class StoredData(StrokeData):
    """Data module that reads strokes from stored sets.

    The first ``limit`` training strokes are read once per epoch, in an order that depends on seed and epoch.
    """

    def __init__(self, paths: Sequence[Path], *, batch_size: int = 64, seed: int = 0, limit: int | None = None) -> None:
        super().__init__()
        self.batch_size, self.seed = batch_size, seed
        self.sets = [StrokeSet(path) for path in paths]
        require_compatible(self.sets)
        self.origin = self.sets[0].origin
        self.shards = [shard for strokes in self.sets for shard in strokes.shards]
        self.parameters = torch.cat([shard.parameters for shard in self.shards])
        self.numbers = np.concatenate([np.arange(len(strokes)) for strokes in self.sets])
        self.places = {split: split.places(self.numbers) for split in Split}
        self.places[Split.TRAINING] = self.places[Split.TRAINING][:limit]
        for split, places in self.places.items():
            if not len(places):
                wrong = f"{', '.join(map(str, paths))}: no stroke is for {split.name.lower()} (limit={limit})"
                raise UserError(f"{wrong}; simulate more than {2 * BLOCK} strokes, and set limit to 1 or more")

    def size(self, split: Split) -> int:
        return len(self.places[split])

    def batches(self, split: Split, epoch: int, first: int) -> Iterator[StrokeBatch]:
        places, n = self.places[split], self.batch_size
        if split is Split.TRAINING:
            groups = shuffle_groups(places, self.numbers[places] // BLOCK, np.random.default_rng([self.seed, epoch]))
        else:
            groups = np.split(places, range(n, len(places), n))
        skip, waiting = first * n, places[:0]  # strokes already read but not yet yielded
        images = pictures_of(self.shards, waiting)
        for group in groups:
            rest, skip = group[skip:], max(0, skip - len(group))
            waiting = np.concatenate([waiting, rest])
            images = np.concatenate([images, pictures_of(self.shards, rest)])
            while len(waiting) >= n:
                yield self._batch(waiting[:n], images[:n])
                waiting, images = waiting[n:], images[n:]
        if len(waiting):
            yield self._batch(waiting, images)

    def _batch(self, places: Numbers, images: Bytes) -> StrokeBatch:
        planes = torch.from_numpy(images).permute(0, 3, 1, 2).contiguous() / 255
        return StrokeBatch(self.parameters[places], planes, torch.from_numpy(self.numbers[places]))


def require_compatible(sets: Sequence[StrokeSet]) -> None:
    """Raise UserError unless all sets have the same engine and window, and no two sets have the same strokes."""
    if not sets:
        raise UserError("no set of strokes is given; give one, made with brushexp task=simulate")
    for one, other in combinations(sets, 2):
        for name in ("engine", "window"):
            ours, theirs = getattr(one.origin, name), getattr(other.origin, name)
            if ours != theirs:
                difference = f"{one.path} has {name} {ours}, and {other.path} has {name} {theirs}"
                raise UserError(f"{difference}; give sets that agree")
        if (one.origin, one.seed) == (other.origin, other.seed):
            repeated = f"{one.path} and {other.path} hold the same strokes (seed {one.seed})"
            raise UserError(f"{repeated}; drop one, or simulate it again with another seed")


def shuffle_groups(places: Numbers, blocks: Numbers, random: np.random.Generator) -> list[Numbers]:
    """Shuffle the positions (n,) of strokes, and return them in groups of `GROUP` whole blocks.

    First the order of the blocks is shuffled, then the positions within each group.
    """
    parts = np.split(places, 1 + np.flatnonzero(np.diff(blocks)))
    order = random.permutation(len(parts))
    groups = (order[k : k + GROUP] for k in range(0, len(order), GROUP))
    return [random.permutation(np.concatenate([parts[k] for k in group])) for group in groups]
