"""Keys of ``task=recover``, and of ``task=train_recovery``."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

from brushexp_training.schema import EMA, NetworkTask
from omegaconf import MISSING, DictConfig

from brushexp.bounds import above, at_least, between
from brushexp.config.keys import key
from brushexp.config.schema import Task
from brushexp.pictures.load import PICTURE
from brushexp_recovery.photograph import size_of_photograph


@dataclass
class RecoverTask(Task):
    """Recover the strokes of a painting from a photograph of it: a catalogue that other tasks take."""

    module = "brushexp_recovery.task"
    alone = "image"

    image: str = key(MISSING, "a photograph of a painting: a picture file, or the name of a sample", PICTURE)
    width_cm: float | None = key(None, "width of what the picture shows, in cm, to measure strokes in mm", above(0))
    scale: float | None = key(None, "at which strokes are sought; null = where they are 18 px wide", between(0.05, 8))
    copies: int = key(1, "turned and mirrored copies that each look shows; more are slower and surer", between(1, 8))
    weights: str = key("strokes", "shipped weights, or the .safetensors of task=train_recovery")

    @staticmethod
    def check(cfg: DictConfig, overrides: Sequence[str]) -> None:
        size_of_photograph(cfg.image)


@dataclass
class TrainRecoveryTask(NetworkTask):
    """Train what task=recover finds strokes with, on paintings made meanwhile."""

    module = "brushexp_recovery.train_task"
    presets: ClassVar[dict[str, str]] = {"trainer": "network"}

    subjects: list[str] | None = key(None, "pictures to paint, or folders of them; null = those of scikit-image")
    start: str | None = key(None, "weights whose network is trained further, shipped or a .safetensors; null = anew")
    sets: str = key("data/recovery", "folder where the paintings are stored; those there are used again")
    paintings: int = key(400, "how many paintings to learn from", at_least(1))
    painters: int = key(1, "processes that make paintings meanwhile", at_least(1))
    batch_size: int = key(5, "crops of a step", at_least(1))
    minutes: float | None = key(100, "limit of wall time, to which the learning rate decays; null = none", at_least(0))
    lr: float = key(3.0e-3, "peak learning rate", above(0, 1))
    ema: float = key(0.998, EMA, between(0, 1))
