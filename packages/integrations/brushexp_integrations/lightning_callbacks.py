"""Make some of Lightning's own callbacks available by name, with their options."""

from __future__ import annotations

import importlib
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from brushexp.contracts import DURATION, at_least, one_of, register
from brushexp.contracts.families import Callback

if TYPE_CHECKING:
    import lightning as L


def lightning_callback(name: str, *args: Any, **options: Any) -> L.Callback:
    """Create one of Lightning's callbacks; Lightning is imported only here, because importing it takes seconds."""
    return getattr(importlib.import_module("lightning.pytorch.callbacks"), name)(*args, **options)


@register("callbacks", "learning_rate_monitor")
class LearningRate(Callback):
    """Add the learning rate to the run's curves (Lightning's LearningRateMonitor)."""

    def open(self, folder: Path) -> L.Callback:
        return lightning_callback("LearningRateMonitor", logging_interval="step")


@register("callbacks", "early_stopping")
@dataclass(kw_only=True)
class StopOnPlateau(Callback):
    """End the fit when a logged value stops improving (Lightning's EarlyStopping).

    Args:
        monitor: name of the value in the curves: ``psnr`` in painting, ``validation/psnr_alpha`` in training.
        mode: direction of improvement: max or min.
        min_delta: smallest change that counts as an improvement.
        patience: number of epochs without improvement before the fit ends; in painting, an epoch is 100 steps.
    """

    monitor: str = "psnr"
    mode: Annotated[str, one_of("max", "min")] = "max"
    min_delta: Annotated[float, at_least(0)] = 0.0
    patience: Annotated[int, at_least(1)] = 3

    def open(self, folder: Path) -> L.Callback:
        return lightning_callback("EarlyStopping", **vars(self))


@register("callbacks", "model_checkpoint")
@dataclass(kw_only=True)
class BestCheckpoints(Callback):
    """Save Lightning checkpoints in the run's ``checkpoints`` folder (Lightning's ModelCheckpoint).

    Args:
        monitor: logged value that ranks the checkpoints; null keeps the last checkpoint, or all with save_top_k=-1.
        mode: direction of improvement: max or min.
        save_top_k: number of checkpoints to keep; -1 = all.
        every_n_train_steps: number of steps between checkpoints.
    """

    monitor: str | None = None
    mode: Annotated[str, one_of("max", "min")] = "max"
    save_top_k: Annotated[int, at_least(-1)] = 1
    every_n_train_steps: Annotated[int, at_least(1)] = 100

    def open(self, folder: Path) -> L.Callback:
        return lightning_callback("ModelCheckpoint", folder / "checkpoints", **vars(self))


@register("callbacks", "timer")
@dataclass(kw_only=True)
class TimeLimit(Callback):
    """End the fit after a given time, and log how long it took (Lightning's Timer).

    Args:
        duration: time limit as days:hours:minutes:seconds; ``00:00:10:00`` is ten minutes.
    """

    duration: Annotated[str, DURATION] = "00:01:00:00"

    def open(self, folder: Path) -> L.Callback:
        return lightning_callback("Timer", **vars(self))
