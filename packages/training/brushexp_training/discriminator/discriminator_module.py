"""``task=train_discriminator``: train and evaluate a network that distinguishes valid from corrupted strokes."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import lightning as L
import numpy as np
import torch
from lightning.pytorch.utilities.types import OptimizerLRScheduler
from omegaconf import DictConfig
from scipy.stats import mannwhitneyu
from torch import Tensor, optim
from torch.nn import functional

from brushexp.contracts.runs import provenance_of
from brushexp.contracts.strokes import sample_prior
from brushexp_training.discriminator.corruption import CORRUPTIONS, corrupt
from brushexp_training.discriminator.discriminator import DISCRIMINATOR, DISCRIMINATORS, Discriminator, shapes_of
from brushexp_training.fitting.network_fitting import NetworkJob, train_network, training_recipe
from brushexp_training.fitting.network_module import NetworkModule
from brushexp_training.stroke_sets.datamodule import EPOCH_STEPS, HELD_OUT, StrokeLoader
from brushexp_training.stroke_sets.dataset import Split

THRESHOLD_QUANTILE = 0.05  # share of valid strokes that score below the threshold
HELD_OUT_STROKES = 20_000  # number of valid and of corrupted strokes
BETAS = (0.9, 0.99)  # betas of Adam


class ShapeBatch(NamedTuple):
    """Shapes (n, 7) of valid strokes, as returned by `discriminator.shapes_of`, and the outputs of `corrupt`."""

    valid: Tensor
    corrupted: Tensor
    hard: Tensor
    kind: Tensor


class ShapeData(L.LightningDataModule):
    """Data module that, at each step, samples ``batch_size`` valid strokes and corrupts an equal number of others."""

    def __init__(self, *, batch_size: int, seed: int) -> None:
        super().__init__()
        self.batch_size, self.seed = batch_size, seed

    def train_dataloader(self) -> StrokeLoader:
        return StrokeLoader(self._batches, EPOCH_STEPS)

    def val_dataloader(self) -> StrokeLoader:
        return StrokeLoader(lambda _epoch, _first: iter([held_out_shapes(self.seed, Split.VALIDATION)]), 1)

    def _batches(self, epoch: int, first: int) -> Iterator[ShapeBatch]:
        for step in range(epoch * EPOCH_STEPS + first, (epoch + 1) * EPOCH_STEPS):
            yield shape_batch(self.batch_size, self.seed, 2 * self.batch_size * step)


class DiscriminatorModule(NetworkModule):
    """Lightning module that trains a discriminator to distinguish valid from corrupted strokes.

    The loss is -log sigma(D(valid)) - log(1 - sigma(D(corrupted))) (Goodfellow et al., 2014), plus a term -log
    sigma(D(hard) - D(corrupted)), which ensures a gradient everywhere by ranking hard negatives above corrupted ones.
    """

    def __init__(self, network: Discriminator, lr: float) -> None:
        super().__init__()
        self.network, self.lr = network.train(), lr

    def configure_optimizers(self) -> OptimizerLRScheduler:
        optimizer = optim.Adam(self.network.parameters(), self.lr, betas=BETAS)
        return {"optimizer": optimizer, "lr_scheduler": {"scheduler": self.schedule(optimizer), "interval": "step"}}

    def training_step(self, batch: ShapeBatch, batch_idx: int) -> Tensor:
        valid, corrupted, hard = self.network(torch.cat(batch[:3])).split(len(batch.valid))
        self.seen += len(batch.valid)
        logistic = functional.softplus(-valid).mean() + functional.softplus(corrupted).mean()
        order = functional.softplus(corrupted - hard).mean()
        self.terms = {"loss/logistic": logistic.detach(), "loss/order": order.detach()}
        return logistic + order

    def validation_step(self, batch: ShapeBatch, batch_idx: int) -> None:
        self.figures, self.validated = discriminator_figures(self.network, batch), self.global_step
        self.log_dict({f"validation/{name}": self.figures[name] for name in ("accuracy", "auc")})

    def state_line(self) -> str:
        quality = f"  held out AUC {self.figures['auc']:.4f}" if self.figures else ""
        return f"loss {float(self.terms['loss/logistic']):.4f}{quality}"


def shape_batch(n: int, seed: int, first: int) -> ShapeBatch:
    """Sample ``n`` valid strokes from the prior, starting at number ``first``, and corrupt the next ``n`` strokes."""
    shapes = shapes_of(sample_prior(2 * n, seed, first))
    state = np.random.SeedSequence([seed, first]).generate_state(1, np.uint64)
    return ShapeBatch(shapes[:n], *corrupt(shapes[n:], torch.Generator().manual_seed(int(state[0]))))


def held_out_shapes(seed: int, split: Split) -> ShapeBatch:
    """Sample the strokes of the validation or test split."""
    return shape_batch(HELD_OUT_STROKES, seed, HELD_OUT[split])


@torch.no_grad()
def discriminator_figures(network: Discriminator, batch: ShapeBatch) -> dict[str, float]:
    """Measure how well a discriminator separates valid from corrupted strokes.

    ``auc`` is also given for each kind of corruption; ``hinge`` is max(0, threshold - score). Some corrupted strokes
    are still valid, so neither accuracy nor AUC can reach 1.
    """
    device, threshold = network.threshold.device, float(network.threshold)
    valid, bad = (network(shapes.to(device)).cpu() for shapes in (batch.valid, batch.corrupted))
    kind = batch.kind.cpu()
    return {
        "accuracy": float(torch.cat([valid > 0, bad <= 0]).double().mean()),
        "auc": area_under_curve(valid, bad),
        **{f"auc_{name}": area_under_curve(valid, bad[kind == k]) for k, name in enumerate(CORRUPTIONS)},
        "threshold": threshold,
        "hinge_valid": float((threshold - valid).clamp_min(0).mean()),
        "hinge_corrupted": float((threshold - bad).clamp_min(0).mean()),
    }


def save_discriminator(network: Discriminator, path: Path, seed: int, training: dict[str, Any]) -> dict[str, object]:
    """Set the threshold to the quantile `THRESHOLD_QUANTILE` of valid strokes' scores, and save the network and recipe.

    Returns its figures on the test split, its hash, its number of parameters and its file size.
    """
    network.eval()
    with torch.no_grad():
        scores = network(held_out_shapes(seed, Split.VALIDATION).valid.to(network.threshold.device))
        network.threshold.copy_(scores.quantile(THRESHOLD_QUANTILE))
    figures = discriminator_figures(network, held_out_shapes(seed, Split.TEST))
    recipe = {
        "options": {},
        "data": {"valid": "strokes.prior", "corrupted": list(CORRUPTIONS), "seed": seed},
        "training": training,
        "figures": figures,
    }
    digest = DISCRIMINATORS.save(path, DISCRIMINATOR, network.cpu(), recipe, half=False)
    parameters = sum(parameter.numel() for parameter in network.parameters())
    return {**figures, "discriminator_hash": digest, "parameters": parameters, "bytes": path.stat().st_size}


def area_under_curve(above: Tensor, below: Tensor) -> float:
    """Compute the area under the ROC curve.

    This is the fraction of pairs in which the score from ``above`` is the higher one; ties count as half.
    """
    return float(mannwhitneyu(above, below, method="asymptotic").statistic) / (len(above) * len(below))


def run(cfg: DictConfig, folder: Path, start: float) -> dict[str, object]:
    """Train a discriminator, write it and its figures into the run's folder, and return the metrics."""
    return train_network(DiscriminatorJob, cfg, folder, start)


class DiscriminatorJob(NetworkJob):
    """Job that trains a discriminator on strokes from the prior."""

    module: DiscriminatorModule

    def __init__(self, cfg: DictConfig, folder: Path, device: torch.device) -> None:
        self.cfg, self.provenance = cfg, provenance_of(cfg)
        self.data = ShapeData(batch_size=cfg.batch_size, seed=cfg.seed)
        self.module = DiscriminatorModule(Discriminator(), cfg.lr)
        self.weights = folder / f"{DISCRIMINATOR}.safetensors"
        self.use = f"brushexp 'loss=[mse,discriminator]' loss.discriminator.checkpoint={self.weights}"

    def finish(self) -> dict[str, object]:
        training = training_recipe(self.module, self.cfg, self.provenance)
        return save_discriminator(self.module.network, self.weights, self.cfg.seed, training)
