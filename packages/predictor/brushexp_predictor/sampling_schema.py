"""Keys of ``task=sample`` and of ``task=calibrate``."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from omegaconf import MISSING, DictConfig

from brushexp.bounds import FILE, at_least, between
from brushexp.config.keys import key
from brushexp.config.schema import Task
from brushexp.pictures.load import PICTURE

WEIGHTS = "weights of the network: a .safetensors file, or the name of one that comes with the program"
TEMPERATURE = "how much strokes differ between samples, in the deviations that the network says"


@dataclass
class SampleTask(Task):
    """Paint a picture many times at a glance, and measure its brushwork with intervals: analyse photo.jpg samples=32.

    The page shows where strokes are certain: how far directions, lengths and widths may be from what is seen.
    """

    module = "brushexp_predictor.sample_task"
    instead_of = "analyse"
    alone = "image"

    image: str = key(MISSING, "a picture file, or the name of a sample", PICTURE)
    samples: int = key(32, "paintings of the picture", between(2, 10_000))
    resolution: int | None = key(512, "resample to this longer side in pixels; null = as it is", between(16, 16384))
    strokes: int | None = key(None, "about how many strokes it has; null = one for every 100 pixels", at_least(1))
    checkpoint: str = key("plain", WEIGHTS)
    temperature: float = key(1.0, TEMPERATURE, between(0, 10))
    intervals: str | None = key(None, "intervals of task=calibrate; null = those beside the weights", FILE)

    @staticmethod
    def suits(typed: Mapping[str, Any]) -> bool:
        return "samples" in typed

    @staticmethod
    def check(cfg: DictConfig, overrides: Sequence[str]) -> None:
        from brushexp_predictor.sampled import scalings_for  # noqa: PLC0415  (``--help`` needs no compiled kernels)

        scalings_for(cfg.checkpoint, cfg.intervals, cfg.temperature)


@dataclass
class CalibrateTask(Task):
    """Fit the intervals of task=sample on paintings whose strokes are known, and measure them on other pictures."""

    module = "brushexp_predictor.calibrate_task"

    checkpoint: str = key("plain", WEIGHTS)
    paintings: int = key(240, "known paintings, of twelve pictures in turn", at_least(8))
    samples: int = key(32, "samples of each painting", between(2, 10_000))
    temperature: float = key(1.0, TEMPERATURE, between(0, 10))
    side: int = key(256, "pixels of the longer side of a painting", between(32, 2048))
    restarts: bool = key(False, "measure gradient descent from other seeds for as many seconds, too")
    keep: bool = key(False, "write the intervals beside the weights, too, where task=sample looks for them")
