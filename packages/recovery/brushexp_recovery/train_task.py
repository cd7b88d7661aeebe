"""``task=train_recovery``: train the network that finds strokes."""

from pathlib import Path

import torch
from brushexp_training.network_fitting import NetworkJob, train_network
from omegaconf import DictConfig

from brushexp.pictures.folders import pictures_in
from brushexp_recovery.network import StrokeNetwork
from brushexp_recovery.synthesis_paintings import PICTURES
from brushexp_recovery.training import RecoveryData, RecoveryModule


def run(cfg: DictConfig, folder: Path, start: float) -> dict[str, object]:
    """Train, write weights and figures into the run's folder, and return those of metrics.json."""
    return train_network(RecoveryJob, cfg, folder, start)


class RecoveryJob(NetworkJob):
    """Train a network on paintings that are made meanwhile."""

    module: RecoveryModule

    def __init__(self, cfg: DictConfig, folder: Path, device: torch.device) -> None:
        self.cfg = cfg
        self.data = RecoveryData(
            Path(cfg.sets), pictures_of(cfg.subjects), cfg.seed, cfg.batch_size, cfg.paintings, cfg.painters
        )
        self.module = RecoveryModule(StrokeNetwork(), cfg.lr)
        self.weights = folder / "recovery.safetensors"
        self.use = f"brushexp recover IMAGE weights={self.weights}"

    def finish(self) -> dict[str, object]:
        torch.save(self.module.network.state_dict(), self.weights.with_suffix(".pt"))
        return {}


def pictures_of(names: list[str] | None) -> list[str]:
    """List the pictures to paint; a folder stands for those in it."""
    found: list[str] = []
    for name in PICTURES if names is None else names:
        found += [str(path) for path in pictures_in(name)] if Path(name).is_dir() else [name]
    return found
