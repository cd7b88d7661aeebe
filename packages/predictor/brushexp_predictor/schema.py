"""Keys of ``task=train model=predictor``."""

from dataclasses import dataclass
from typing import ClassVar

from brushexp_training.schema import EMA, NetworkTask

from brushexp.bounds import above, at_least, between, one_of
from brushexp.config.keys import key

DATA = "pictures to learn from, or folders of them; null = those of scikit-image and scikit-learn"


@dataclass
class TrainPredictorTask(NetworkTask):
    """Train what init=predicted lays strokes with, through the renderer; task=train model=predictor, too."""

    module = "brushexp_predictor.train_task"
    presets: ClassVar[dict[str, str]] = {"trainer": "default"}  # in 32 bits, which what draws strokes needs

    model: str = key("predictor", "what is trained", one_of("predictor"))
    data: list[str] | None = key(None, DATA)
    form: str = key("plain", "of the strokes: plain, or brushed: long, opaque, of bristles", one_of("plain", "brushed"))
    start: str | None = key(None, "weights to go on from, shipped or a .safetensors; null = anew")
    batch_size: int = key(8, "pictures of a step", at_least(1))
    lr: float = key(2.0e-3, "peak learning rate", above(0, 1))
    ema: float = key(0.996, EMA, between(0, 1))
