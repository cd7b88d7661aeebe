"""Train the network, through the renderer and without labels, to reduce the errors of its paintings."""

import math
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial
from typing import NamedTuple

import lightning as L
import numpy as np
import torch
from brushexp_training.fitting.network_module import NetworkModule
from brushexp_training.stroke_sets.datamodule import EPOCH_STEPS, StrokeLoader
from lightning.pytorch.utilities.types import OptimizerLRScheduler
from torch import Tensor, optim

from brushexp.contracts import build_named
from brushexp.contracts.pictures import psnr_of
from brushexp.contracts.strokes import Catalogue, Strokes
from brushexp_predictor.lay.decoding import draw
from brushexp_predictor.lay.network import CELL, StrokePredictor
from brushexp_predictor.lay.pyramid import Laid, Level, errors_of, lay, levels_of, resize_picture
from brushexp_predictor.train.subjects import Subjects

CELLS = 32  # number of cells of the last level along the side of a training picture
SIDES = (72, 288)  # side in pixels of the smallest and the largest picture of a batch
KEPT = ((0.1, 0.4), (0.2, 0.6), (0.1, 0.8))  # ranges of the share of a painting's strokes in each of the last levels
WEIGHTS = (0.25, 0.25, 0.25, 0.5, 1.0)  # weight of the error after each level
FLOOR = 5e-5  # mean squared error that counts as none
REFINED = (0, 10)  # numbers of optimiser steps after which validation measures
VARIED = 0.6  # share of the training after which every other step paints a sample
BONUS = 0.2  # weight of the mean log deviation, at which samples are about 0.4 dB worse than the painting
WORTH = 0.3  # weight of the error of the predicted worth
DECAY = 1e-3  # weight decay
AHEAD = 2  # number of batches made in advance
HELD_OUT = 2**40  # number of the first validation picture
VALIDATED = 4  # number of validation batches


class Batch(NamedTuple):
    """Square target pictures of different sizes, and the levels in which they are painted."""

    targets: list[Tensor]  # (3, S, S)
    levels: list[Level]


class PredictorData(L.LightningDataModule):
    """Training pictures that are generated on demand, each determined by seed and number."""

    def __init__(self, subjects: Subjects, batch_size: int) -> None:
        super().__init__()
        self.subjects, self.batch_size = subjects, batch_size

    def train_dataloader(self) -> StrokeLoader:
        return StrokeLoader(self._training_batches, EPOCH_STEPS)

    def val_dataloader(self) -> StrokeLoader:
        return StrokeLoader(lambda _epoch, _first: map(self.held_out_batch, range(VALIDATED)), VALIDATED)

    def held_out_batch(self, number: int) -> Batch:
        """Make a validation batch, with strokes divided among the levels as in a painting, not at random."""
        first = HELD_OUT + number * self.batch_size
        return Batch(self._pictures(first), levels_of((CELLS, CELLS), (CELLS // 2) ** 2))

    def _training_batches(self, epoch: int, first: int) -> Iterator[Batch]:
        """Yield an epoch's batches from step ``first`` on; a thread makes them in advance while the network learns."""
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
        levels = levels_of((CELLS, CELLS), n)
        kept = [round(n * random.uniform(*between)) for between in KEPT]
        fine = [level._replace(keep=keep) for level, keep in zip(levels[-len(KEPT) :], kept, strict=True)]
        return Batch(self._pictures(step * self.batch_size), [*levels[: -len(KEPT)], *fine])

    def _pictures(self, first: int) -> list[Tensor]:
        small, large = np.log(SIDES)
        sides = np.exp(small + (large - small) * (np.arange(self.batch_size) + 0.5) / self.batch_size)
        return [self.subjects(first + k, round(side)) for k, side in enumerate(sides)]


class PredictorModule(NetworkModule):
    """Lightning module that trains the network so that paintings made of its strokes match the pictures.

    After a fraction `VARIED` of the training, every other step paints a sample: the output numbers vary by the
    predicted deviations, and large deviations are rewarded (the bound of Kingma and Welling, 2014, with an error that
    is relative to the painting's error instead of fixed).
    """

    title = "learning to paint"
    clip_norm = 1.0

    def __init__(self, network: StrokePredictor, lr: float, seed: int) -> None:
        super().__init__()
        self.network, self.lr, self.seed = network.train(), lr, seed

    def configure_optimizers(self) -> OptimizerLRScheduler:
        optimizer = optim.AdamW(self.network.parameters(), self.lr, weight_decay=DECAY, betas=(0.9, 0.98))
        return {"optimizer": optimizer, "lr_scheduler": {"scheduler": self.schedule(optimizer), "interval": "step"}}

    def training_step(self, batch: Batch, batch_idx: int) -> Tensor:
        sampled = self.progress > VARIED and batch_idx % 2 == 1
        generator = torch.Generator().manual_seed(hash((self.seed, self.global_step)) % 2**62)
        painting = lay(self.network, self.network.form, batch.targets, batch.levels, generator, float(sampled))
        loss = torch.zeros(())
        for weight, level, done in zip(WEIGHTS, batch.levels, painting, strict=True):
            error = mean_of(log_error, done, batch.targets)
            expected = mean_of(partial(worth_error, level=level), done, batch.targets)
            loss = loss + weight * error + WORTH * expected
            if sampled:
                loss = loss - weight * BONUS * torch.cat([laid.cells.deviations for laid in done]).mean()
        self.seen += sum(len(laid.strokes) for laid in done)
        self.terms = {"loss/error": error.detach(), "loss/worth": expected.detach()}
        return loss

    @torch.no_grad()
    def validation_step(self, batch: Batch, batch_idx: int) -> None:
        *_, done = lay(self.network, self.network.form, batch.targets, batch.levels)
        for steps in REFINED:
            psnr = [psnr_after(laid, target, steps) for laid, target in zip(done, batch.targets, strict=True)]
            before = batch_idx * self.figures.get(f"psnr_{steps}", 0.0)
            self.figures[f"psnr_{steps}"] = (before + sum(psnr) / len(psnr)) / (batch_idx + 1)
        self.validated = self.global_step
        if batch_idx + 1 == VALIDATED:
            self.log_dict({f"validation/{name}": value for name, value in self.figures.items()}, batch_size=1)

    def state_line(self) -> str:
        return f"{-10 * float(self.terms['loss/error']) / math.log(10):.2f} dB" if self.terms else ""


def mean_of(measure: Callable[[Laid, Tensor], Tensor], done: Sequence[Laid], targets: Sequence[Tensor]) -> Tensor:
    """Average a measure over the canvases after a level."""
    return torch.stack([measure(laid, target) for laid, target in zip(done, targets, strict=True)]).mean()


def log_error(laid: Laid, target: Tensor) -> Tensor:
    """Compute the logarithm of a canvas's mean squared error, so that all pictures have the same weight."""
    small = resize_picture(target, (laid.canvas.shape[1], laid.canvas.shape[2]))
    return torch.log((laid.canvas - small).square().mean() + FLOOR)


def worth_error(laid: Laid, target: Tensor, level: Level) -> Tensor:
    """Compare the predicted fraction of each cell's error that its stroke removes with the actual one (mean square)."""
    shape = (CELL * level.rows, CELL * level.columns)
    after = errors_of(resize_picture(target, shape)[None], resize_picture(laid.canvas.detach(), shape)[None]).flatten()[
        laid.places
    ]
    weight = laid.cells.errors + FLOOR
    removed = (1 - (after + FLOOR) / weight).clamp(0, 1)
    return (weight * (laid.cells.worth.sigmoid() - removed).square()).sum() / weight.sum()


def refine(strokes: Strokes, target: Tensor, draw: Callable[[Strokes], Tensor], steps: int) -> Strokes:
    """Optimise strokes for a target (3, H, W) by ``steps`` of the default optimiser, without changing their order."""
    plan = build_named("optimizer", "torch", {"options": {"betas": [0.9, 0.95], "eps": 1e-15}})
    with torch.inference_mode(False), torch.enable_grad():  # Lightning's validation disables gradients
        catalogue, target = Catalogue(strokes.map(Tensor.clone), plan.units), target.clone()
        optimizer = plan.over(catalogue.parameters())
        for step in range(steps):
            for group in optimizer.param_groups:
                group["lr"] = plan.lr * plan.share(step / steps)
            optimizer.zero_grad()
            (draw(catalogue()) - target).square().mean().backward()
            optimizer.step()
            catalogue.keep_in_range()
        return catalogue().map(Tensor.detach)


def psnr_after(laid: Laid, target: Tensor, steps: int) -> float:
    """Compute the PSNR in dB of a canvas after its strokes have been optimised for ``steps`` steps."""

    def draw_strokes(strokes: Strokes) -> Tensor:
        return draw(laid.form, strokes, laid.size, laid.background)

    canvas = draw_strokes(refine(laid.strokes, target, draw_strokes, steps)) if steps else laid.canvas
    return psnr_of(float((canvas.clamp(0, 1) - target).square().mean()))
