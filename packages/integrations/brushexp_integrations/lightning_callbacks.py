"""Callbacks that come with Lightning, by name; their options are Lightning's own."""

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
    """Make a callback of Lightning, which takes seconds to import."""
    return getattr(importlib.import_module("lightning.pytorch.callbacks"), name)(*args, **options)


@register("callbacks", "learning_rate_monitor")
class LearningRate(Callback):
    """Record the learning rate among the curves of the run (Lightning's LearningRateMonitor)."""

    def open(self, folder: Path) -> L.Callback:
        return lightning_callback("LearningRateMonitor", logging_interval="step")


@register("callbacks", "early_stopping")
@dataclass(kw_only=True)
class StopOnPlateau(Callback):
    """End the fit when a logged value no longer improves (Lightning's EarlyStopping).

    Args:
        monitor: the value, as the curves call it: ``psnr`` in painting, ``validation/psnr_alpha`` in training.
        mode: max where more is better, min where less is.
        min_delta: least gain that counts.
        patience: epochs without a gain before the end, in painting of 100 steps each.
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
    """Keep checkpoints of Lightning in the folder ``checkpoints`` of the run (ModelCheckpoint).

    Args:
        monitor: the logged value by which the best are chosen; null keeps the last one, or with save_top_k=-1 all.
        mode: max where more is better, min where less is.
        save_top_k: how many; -1 for all.
        every_n_train_steps: steps between two of them.
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
    """End the fit after some time, and say how long it took (Lightning's Timer).

    Args:
        duration: days:hours:minutes:seconds, ``00:00:10:00`` for ten minutes.
    """

    duration: Annotated[str, DURATION] = "00:01:00:00"

    def open(self, folder: Path) -> L.Callback:
        return lightning_callback("Timer", **vars(self))
