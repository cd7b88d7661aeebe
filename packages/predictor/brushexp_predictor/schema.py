"""Keys of ``task=train_predictor``, of ``task=sample`` and of ``task=calibrate``."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

from brushexp_training.schema import EMA, NetworkTask
from omegaconf import MISSING, DictConfig

from brushexp.contracts import FILE, above, at_least, between, one_of
from brushexp.contracts.tasks import PICTURE, Task, key

DATA = "pictures to learn from, or folders of them; null = those of scikit-image and scikit-learn"
WEIGHTS = "weights of the network: a .safetensors file, or the name of one that comes with the program"
TEMPERATURE = "how much strokes differ between samples, in the deviations that the network says"


@dataclass
class TrainPredictorTask(NetworkTask):
    """Train what init=predicted lays strokes with, through the renderer."""

    module = "brushexp_predictor.train.task"
    presets: ClassVar[dict[str, str]] = {"trainer": "default"}  # in 32 bits, which what draws strokes needs

    data: list[str] | None = key(None, DATA)
    form: str = key("plain", "of the strokes: plain, or brushed: long, opaque, of bristles", one_of("plain", "brushed"))
    start: str | None = key(None, "weights to go on from, shipped or a .safetensors; null = anew")
    batch_size: int = key(8, "pictures of a step", at_least(1))
    lr: float = key(2.0e-3, "peak learning rate", above(0, 1))
    ema: float = key(0.996, EMA, between(0, 1))


@dataclass
class SampleTask(Task):
    """Paint a picture many times at a glance, and measure its brushwork with intervals: analyse photo.jpg samples=32.

    The page shows where strokes are certain: how far directions, lengths and widths may be from what is seen.
    """

    module = "brushexp_predictor.samples.task"
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
        from brushexp_predictor.samples.sampled import scalings_for  # noqa: PLC0415  (``--help`` needs no compiled kernels)

        scalings_for(cfg.checkpoint, cfg.intervals, cfg.temperature)


@dataclass
class CalibrateTask(Task):
    """Fit the intervals of task=sample on paintings whose strokes are known, and measure them on other pictures."""

    is_research = True
    module = "brushexp_predictor.samples.calibrate_task"

    checkpoint: str = key("plain", WEIGHTS)
    paintings: int = key(240, "known paintings, of twelve pictures in turn", at_least(8))
    samples: int = key(32, "samples of each painting", between(2, 10_000))
    temperature: float = key(1.0, TEMPERATURE, between(0, 10))
    side: int = key(256, "pixels of the longer side of a painting", between(32, 2048))
    restarts: bool = key(False, "measure gradient descent from other seeds for as many seconds, too")
    keep: bool = key(False, "write the intervals beside the weights, too, where task=sample looks for them")
