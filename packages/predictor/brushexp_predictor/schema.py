"""Configuration keys of ``task=train_predictor``, ``task=sample`` and ``task=calibrate``."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

from brushexp_training.schema import EMA, NetworkTask
from omegaconf import MISSING, DictConfig

from brushexp.contracts import FILE, above, at_least, between, one_of
from brushexp.contracts.tasks import PICTURE, Task, key

DATA = "training pictures, or folders of them; null = pictures of scikit-image and scikit-learn"
WEIGHTS = "weights of the network: a .safetensors file, or the name of shipped weights"
TEMPERATURE = "spread of strokes between samples, in the standard deviations that the network predicts"


@dataclass
class TrainPredictorTask(NetworkTask):
    """Train the network for init=predicted through the renderer."""

    module = "brushexp_predictor.train.task"
    presets: ClassVar[dict[str, str]] = {"trainer": "default"}  # in 32 bits, which renderers need

    data: list[str] | None = key(None, DATA)
    form: str = key(
        "plain", "kind of strokes: plain, or brushed (long, opaque bristle strokes)", one_of("plain", "brushed")
    )
    start: str | None = key(None, "initial weights, shipped or a .safetensors file; null = random")
    batch_size: int = key(8, "pictures per gradient step", at_least(1))
    lr: float = key(2.0e-3, "peak learning rate", above(0, 1))
    ema: float = key(0.996, EMA, between(0, 1))


@dataclass
class SampleTask(Task):
    """Paint a picture many times, and measure its brushwork with intervals: analyse photo.jpg samples=32.

    The page shows how certain the strokes' directions, lengths and widths are in each area.
    """

    module = "brushexp_predictor.samples.task"
    alone = "image"

    image: str = key(MISSING, "picture file, or the name of a sample", PICTURE)
    samples: int = key(32, "number of paintings of the picture", between(2, 10_000))
    resolution: int | None = key(512, "longer side of the picture in pixels; null = its own", between(16, 16384))
    strokes: int | None = key(
        None, "approximate number of strokes; null = one per 100 pixels", at_least(1, typical=1000)
    )
    checkpoint: str = key("plain", WEIGHTS)
    temperature: float = key(1.0, TEMPERATURE, between(0, 10))
    intervals: str | None = key(None, "file of intervals from task=calibrate; null = the file beside the weights", FILE)

    @staticmethod
    def suits(typed: Mapping[str, Any]) -> bool:
        return "samples" in typed

    @staticmethod
    def check(cfg: DictConfig, overrides: Sequence[str]) -> None:
        from brushexp_predictor.samples.sampled import scalings_for  # noqa: PLC0415  (``--help`` needs no compiled kernels)

        scalings_for(cfg.checkpoint, cfg.intervals, cfg.temperature)


@dataclass
class CalibrateTask(Task):
    """Fit the intervals for task=sample to paintings with known strokes, and test them on other pictures."""

    is_research = True
    module = "brushexp_predictor.samples.calibrate_task"

    checkpoint: str = key("plain", WEIGHTS)
    paintings: int = key(240, "number of known paintings, made from twelve pictures in turn", at_least(8))
    samples: int = key(32, "number of samples of each painting", between(2, 10_000))
    temperature: float = key(1.0, TEMPERATURE, between(0, 10))
    side: int = key(256, "longer side of a painting in pixels", between(32, 2048))
    restarts: bool = key(False, "whether to also measure gradient descent from other seeds in equal time")
    keep: bool = key(False, "whether to also write the intervals beside the weights, for task=sample")
