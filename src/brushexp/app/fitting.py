"""The Lightning Trainer of a task, with the device, options and callbacks of its config; an interrupted fit goes on."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import lightning as L
import torch
from hydra.core.hydra_config import HydraConfig
from lightning.fabric.utilities.exceptions import MisconfigurationException
from lightning.pytorch.loggers import Logger
from omegaconf import DictConfig, OmegaConf

from brushexp.app.composition import check
from brushexp.errors import UserError
from brushexp.registry import build
from brushexp.system.callbacks import ProgressBar, TimedCheckpoint

CHECKPOINT = "checkpoint.ckpt"  # in a run's folder
OVERRIDABLE = ("output", "device", "threads", "checkpoint_every")  # keys that may change when a run is resumed


def trainer_of(
    cfg: DictConfig,
    device: torch.device,
    folder: Path,
    loggers: Sequence[Logger],
    callbacks: Sequence[L.Callback] = (),
    **options: Any,
) -> L.Trainer:
    """A Trainer with a progress bar, checkpoints by time and a clean end at Ctrl-C.

    Of ``cfg`` it reads ``trainer`` (options of Lightning's Trainer, which win over ``options``), ``callbacks`` (beside
    those given) and ``checkpoint_every``.

    Raises:
        UserError: if the Trainer does not take an option.
    """
    chosen = [build(node).open(folder) for node in cfg.callbacks.values()]
    checkpoint = TimedCheckpoint(folder / CHECKPOINT, cfg.checkpoint_every)
    cuda = device.type == "cuda"
    try:
        return L.Trainer(
            accelerator="gpu" if cuda else "cpu",
            devices=[device.index or 0] if cuda else 1,
            default_root_dir=folder,
            logger=list(loggers),
            callbacks=[*callbacks, *chosen, ProgressBar(), checkpoint],
            **options | {str(key): value for key, value in cfg.trainer.items()},
        )
    except (TypeError, ValueError, MisconfigurationException) as error:
        raise UserError(f"trainer: {error}; see the options of Lightning's Trainer") from error


def interrupted_run(folder: Path, cfg: DictConfig) -> tuple[Path, DictConfig]:
    """Checkpoint and settings of a run that is to be continued.

    Raises:
        UserError: if there is nothing to continue there, or the command line changes what must stay.
    """
    settings, checkpoint = folder / ".hydra" / "config.yaml", folder / CHECKPOINT
    for path in (settings, checkpoint):
        if not path.is_file():
            raise UserError(f"resume={folder}: there is no {path.name}; give the folder of an interrupted run")
    for override in HydraConfig.get().overrides.task:
        if override.lstrip("+~").partition("=")[0] not in (*OVERRIDABLE, "resume", "task"):
            raise UserError(f"resume continues a run with its own settings; drop {override}")
    kept = OmegaConf.load(settings)
    assert isinstance(kept, DictConfig)
    kept.merge_with({key: cfg[key] for key in OVERRIDABLE})
    check(kept)
    return checkpoint, kept
