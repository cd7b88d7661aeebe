"""The Lightning Trainer of a task: the device, the config's trainer options, and its callbacks."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import lightning as L
import torch
from lightning.fabric.utilities.exceptions import MisconfigurationException
from lightning.pytorch.loggers import Logger
from omegaconf import DictConfig

from brushexp.app.resuming import CHECKPOINT
from brushexp.errors import UserError
from brushexp.registry import build
from brushexp.system.callbacks import GracefulInterrupt, ProgressBar, TimedCheckpoint


def trainer_of(
    cfg: DictConfig,
    device: torch.device,
    folder: Path,
    loggers: Sequence[Logger],
    callbacks: Sequence[L.Callback] = (),
    **options: Any,
) -> L.Trainer:
    """A Trainer with a progress bar, checkpoints by time and a clean end at Ctrl-C.

    Args:
        cfg: of the run: ``trainer`` (options of Lightning's Trainer), ``callbacks`` and ``checkpoint_every`` are read.
        device: where the module is.
        folder: of the run.
        loggers: of the curves.
        callbacks: those of the task.
        options: of the Trainer, by the task; those of the config win.

    Raises:
        UserError: if the Trainer does not take an option.
    """
    chosen = [build(node).open(folder) for node in cfg.callbacks.values()]
    interrupt = GracefulInterrupt("stopping after this step; what is done so far will be written")
    checkpoint = TimedCheckpoint(folder / CHECKPOINT, cfg.checkpoint_every)
    cuda = device.type == "cuda"
    options |= {str(key): value for key, value in cfg.trainer.items()}
    try:
        return L.Trainer(
            accelerator="gpu" if cuda else "cpu",
            devices=[device.index or 0] if cuda else 1,
            default_root_dir=folder,
            logger=list(loggers),
            callbacks=[interrupt, *callbacks, *chosen, ProgressBar(), checkpoint],
            **options,
        )
    except (TypeError, ValueError, MisconfigurationException) as error:
        raise UserError(f"trainer: {error}; see the options of Lightning's Trainer") from error
