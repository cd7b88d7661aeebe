"""Define the config keys of ``task=train_discriminator``."""

from dataclasses import dataclass
from typing import Any, ClassVar

from brushexp.contracts import above, at_least, between
from brushexp.contracts.tasks import key
from brushexp_training.schema import EMA, NetworkTask


@dataclass
class TrainDiscriminatorTask(NetworkTask):
    """Train a network that recognises valid strokes, for loss=discriminator."""

    module = "brushexp_training.discriminator.discriminator_module"
    presets: ClassVar[dict[str, str]] = {"trainer": "default"}
    settings: ClassVar[dict[str, Any]] = {"trainer": {"log_every_n_steps": 20}}

    batch_size: int = key(512, "valid strokes per step, and as many corrupted strokes", at_least(1))
    epochs: int | None = key(8, "number of epochs of 500 steps, all with new strokes; null = no limit", at_least(0))
    minutes: float | None = key(
        None, "wall time limit; null = none; the learning rate decays until the first limit", at_least(0, typical=60)
    )
    lr: float = key(5.0e-3, "peak learning rate", above(0, 1))
    ema: float = key(0, EMA, between(0, 1))
