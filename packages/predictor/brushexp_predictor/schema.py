"""Keys of ``task=train model=predictor``."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

from brushexp_training.rules import check_ends
from brushexp_training.schema import EMA, NETWORK_FIT
from omegaconf import DictConfig

from brushexp.bounds import INTERRUPTED_RUN, above, at_least, between, one_of
from brushexp.config.keys import key
from brushexp.config.schema import RESUME, Task, TrainerOptions

DATA = "pictures to learn from, or folders of them; null = those of scikit-image and scikit-learn"


@dataclass
class TrainPredictorTask(Task):
    """Train what init=predicted lays strokes with, through the renderer; task=train model=predictor, too."""

    module = "brushexp_predictor.train_task"
    instead_of = "train"
    groups: ClassVar[dict[str, Any]] = NETWORK_FIT
    presets: ClassVar[dict[str, str]] = {"trainer": "default"}  # in 32 bits, which what draws strokes needs

    model: str = key("predictor", "what is trained", one_of("predictor"))
    data: list[str] | None = key(None, DATA)
    form: str = key("plain", "of the strokes: plain, or brushed: long, opaque, of bristles", one_of("plain", "brushed"))
    start: str | None = key(None, "weights to go on from, shipped or a .safetensors; null = anew")
    batch_size: int = key(8, "pictures of a step", at_least(1))
    epochs: int | None = key(None, "of 500 steps each; null = no limit", at_least(0))
    minutes: float | None = key(60, "limit of wall time, to which the learning rate decays; null = none", at_least(0))
    lr: float = key(2.0e-3, "peak learning rate", above(0, 1))
    ema: float = key(0.996, EMA, between(0, 1))
    checkpoint_every: float | None = key(120, "seconds between checkpoints; null = only when interrupted", at_least(0))
    resume: str | None = key(None, RESUME, INTERRUPTED_RUN)
    trainer: TrainerOptions = field(default_factory=TrainerOptions)

    @staticmethod
    def suits(typed: Mapping[str, Any]) -> bool:
        return typed.get("model") == "predictor"

    @staticmethod
    def check(cfg: DictConfig, overrides: Sequence[str]) -> None:
        check_ends(cfg)
