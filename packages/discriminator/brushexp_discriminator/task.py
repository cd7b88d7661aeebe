"""``task=train_discriminator``: train a network that tells valid strokes from corrupted ones."""

from pathlib import Path

import torch
from brushexp_training.network_fitting import NetworkJob, train_network, training_recipe
from omegaconf import DictConfig

from brushexp_discriminator.discriminator import NAME, Discriminator
from brushexp_discriminator.discriminator_module import DiscriminatorModule, ShapeData, save_discriminator


def run(cfg: DictConfig, folder: Path, start: float) -> dict[str, object]:
    """Train a discriminator, write it and its numbers into the run's folder, and return those of metrics.json."""
    return train_network(DiscriminatorJob, cfg, folder, start)


class DiscriminatorJob(NetworkJob):
    """Train a discriminator on strokes of the prior."""

    module: DiscriminatorModule

    def __init__(self, cfg: DictConfig, folder: Path, device: torch.device) -> None:
        self.cfg = cfg
        self.data = ShapeData(batch_size=cfg.batch_size, seed=cfg.seed)
        self.module = DiscriminatorModule(Discriminator(), cfg.lr)
        self.weights = folder / f"{NAME}.safetensors"
        self.use = f"brushexp 'loss=[mse,discriminator]' loss.discriminator.checkpoint={self.weights}"

    def finish(self) -> dict[str, object]:
        recipe = training_recipe(self.module, self.cfg)
        return save_discriminator(self.module.network, self.weights, self.cfg.seed, recipe)
