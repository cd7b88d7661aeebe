"""The network learns through the renderer: by the error of the pictures of its strokes, without labels."""

import math
from collections import deque
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import NamedTuple

import lightning as L
import numpy as np
import torch
from brushexp_training.datamodule import EPOCH_STEPS, StrokeLoader
from brushexp_training.network_module import NetworkModule
from lightning.pytorch.utilities.types import OptimizerLRScheduler
from torch import Tensor, optim

from brushexp_predictor.drawing import draw_plain
from brushexp_predictor.network import CELL, StrokePredictor
from brushexp_predictor.pyramid import Laid, Level, errors_of, lay, levels_of, resized
from brushexp_predictor.subjects import Subjects

CELLS = 32  # of the last level along the side of a picture that is learnt from
SIDES = (72, 288)  # pixels of such a picture; the smallest and the largest of a batch
KEPT = ((0.25, 0.7), (0.1, 0.8))  # ranges of the strokes of the last two levels, in strokes of a painting
WEIGHTS = (0.25, 0.25, 0.5, 1.0)  # of the errors after each level
FLOOR = 5e-5  # mean squared error that is as good as none
WORTH = 0.3  # weight of the error of what the network expects of its strokes
DECAY = 1e-3  # of the weights
AHEAD = 2  # batches that are made in advance
HELD_OUT = 2**40  # first number of the pictures of validation
VALIDATED = 8  # batches of validation


class Batch(NamedTuple):
    """Square pictures, each of its own size, and the levels in which they are painted."""

    targets: list[Tensor]  # (3, S, S)
    levels: list[Level]


class PredictorData(L.LightningDataModule):
    """Pictures made on the way, each decided by seed and number."""

    def __init__(self, subjects: Subjects, batch_size: int) -> None:
        super().__init__()
        self.subjects, self.batch_size = subjects, batch_size

    def train_dataloader(self) -> StrokeLoader:
        return StrokeLoader(self._training, EPOCH_STEPS)

    def val_dataloader(self) -> StrokeLoader:
        return StrokeLoader(lambda _epoch, _first: map(self.held_out, range(VALIDATED)), VALIDATED)

    def held_out(self, number: int) -> Batch:
        """Make a batch of validation, with the levels that paintings have."""
        first = HELD_OUT + number * self.batch_size
        return Batch(self._pictures(first), levels_of((CELLS, CELLS), (CELLS // 2) ** 2))

    def _training(self, epoch: int, first: int) -> Iterator[Batch]:
        """Make each batch in a thread of its own while the network learns from the one before."""
        with ThreadPoolExecutor(1) as maker:
            waiting = deque[Future[Batch]]()
            for step in range(epoch * EPOCH_STEPS + first, (epoch + 1) * EPOCH_STEPS):
                waiting.append(maker.submit(self._batch, step))
                if len(waiting) > AHEAD:
                    yield waiting.popleft().result()
            while waiting:
                yield waiting.popleft().result()

    def _batch(self, step: int) -> Batch:
        random = np.random.default_rng([self.subjects.seed, step, 1])
        n = (CELLS // 2) ** 2
        *coarse, third, last = levels_of((CELLS, CELLS), n)
        kept = [max(1, round(n * random.uniform(*between))) for between in KEPT]
        fine = [Level(level.rows, level.columns, keep, level.side) for level, keep in zip((third, last), kept)]
        return Batch(self._pictures(step * self.batch_size), [*coarse, *fine])

    def _pictures(self, first: int) -> list[Tensor]:
        small, large = np.log(SIDES)
        sides = np.exp(small + (large - small) * (np.arange(self.batch_size) + 0.5) / self.batch_size)
        return [self.subjects(first + k, round(side)) for k, side in enumerate(sides)]


class PredictorModule(NetworkModule):
    """Moves the weights of the network until its strokes look like the pictures."""

    title = "learning to paint"
    clip_norm = 1.0

    def __init__(self, network: StrokePredictor, lr: float) -> None:
        super().__init__()
        self.network, self.lr = network.train(), lr

    def configure_optimizers(self) -> OptimizerLRScheduler:
        optimizer = optim.AdamW(self.network.parameters(), self.lr, weight_decay=DECAY, betas=(0.9, 0.98))
        return {"optimizer": optimizer, "lr_scheduler": {"scheduler": self.schedule(optimizer), "interval": "step"}}

    def training_step(self, batch: Batch, batch_idx: int) -> Tensor:
        done = list(lay(self.network, batch.targets, batch.levels, draw_plain))
        self.seen += sum(len(laid.strokes) for laid in done[-1])
        losses = [torch.stack([log_error(laid, target) for laid, target in zip(level, batch.targets, strict=True)]).mean() for level in done]
        worth = self._worth_loss(batch, done)
        self.terms = {f"loss/level_{k}": loss.detach() for k, loss in enumerate(losses)} | {"loss/worth": worth.detach()}
        return sum((weight * loss for weight, loss in zip(WEIGHTS, losses, strict=True)), WORTH * worth)

    def _worth_loss(self, batch: Batch, done: list[list[Laid]]) -> Tensor:
        """Compare the share of a cell's error that a stroke removed with what the network expected."""
        total = torch.zeros(())
        for number, level in enumerate(batch.levels):
            for k, target in enumerate(batch.targets):
                shape = (CELL * level.rows, CELL * level.columns)
                seen = resized(target, shape)
                canvas = resized(done[number - 1][k].canvas.detach(), shape) if number else target.mean((1, 2))[:, None, None].expand_as(seen)
                cells = done[number][k].cells
                before = errors_of(seen[None], canvas[None])[0].flatten()[cells]
                after = errors_of(seen[None], resized(done[number][k].canvas.detach(), shape)[None])[0].flatten()[cells]
                removed = 1 - (after + FLOOR) / (before + FLOOR)
                weight = before + FLOOR
                total = total + (weight * (done[number][k].worth.sigmoid() - removed.clamp(0, 1)).square()).sum() / weight.sum()
        return total / (len(batch.levels) * len(batch.targets))

    def state_line(self) -> str:
        return f"{-10 * float(self.terms['loss/level_3']) / math.log(10):.2f} dB" if self.terms else ""


def log_error(laid: Laid, target: Tensor) -> Tensor:
    """Compute the logarithm of the mean squared error of a canvas, so that all pictures count alike."""
    small = resized(target, (laid.canvas.shape[1], laid.canvas.shape[2]))
    return torch.log((laid.canvas - small).square().mean() + FLOOR)
