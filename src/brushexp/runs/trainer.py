"""The Lightning Trainer of a task, with the device, options and callbacks of its config, and how its fit ends."""

import logging
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import lightning as L
import torch
from lightning.pytorch.loggers import Logger
from omegaconf import DictConfig

from brushexp.errors import UserError
from brushexp.plugin_errors import EXPLAINED_ERRORS, mistake_of
from brushexp.registry import plugins, take_built
from brushexp.runs.resume import RunRecord
from brushexp.runs.sweep_report import first_line
from brushexp.system.callbacks import DIVERGED, FAILED, INTERRUPTED, ProgressBar, TimedCheckpoint
from brushexp.system.reading import in_short
from brushexp.system.run_files import CHECKPOINT

log = logging.getLogger(__name__)


def make_trainer(
    cfg: DictConfig,
    device: torch.device,
    folder: Path | None,
    loggers: Sequence[Logger],
    callbacks: Sequence[L.Callback] = (),
    *,
    checkpoints: bool = True,
    **options: Any,
) -> L.Trainer:
    """A Trainer with a progress bar and a clean end at Ctrl-C; where there is a ``folder``, with ``checkpoints``.

    Of ``cfg`` it reads ``trainer`` (options of Lightning's Trainer, which win over ``options``; a UserError says which
    it does not take), ``checkpoint_every`` and, if there is a folder that they may write into, ``callbacks`` (beside
    those given).
    """
    chosen = [take_built(node).open(folder) for node in cfg.callbacks.values()] if folder else []
    warnings.filterwarnings("ignore", ".*in eval mode at the start of training")  # networks are frozen on purpose
    warnings.filterwarnings("ignore", ".*LeafSpec.*", FutureWarning)  # Lightning calls a name that torch deprecates
    record = RunRecord(cfg, folder)
    kept = None if folder is None or not checkpoints else folder / CHECKPOINT
    checkpoint = TimedCheckpoint(kept, cfg.get("checkpoint_every"))
    cuda = device.type == "cuda"
    try:
        return L.Trainer(
            accelerator="gpu" if cuda else "cpu",
            devices=[device.index or 0] if cuda else 1,
            default_root_dir=folder,
            logger=list(loggers),
            callbacks=[*callbacks, *chosen, record, ProgressBar(), checkpoint],
            **options | {str(key): value for key, value in cfg.trainer.items() if value is not None},
        )
    except Exception as error:  # a checkpoint's options may be anything
        raise UserError(f"trainer: {error}; see the options of Lightning's Trainer") from error


def fit(trainer: L.Trainer, module: Any, data: Any = None, checkpoint: Path | None = None) -> BaseException | None:
    """Fit a module, from a checkpoint if there is one; what is done is then to be written, and `conclude` to be called.

    What goes wrong before the first step is raised, such as a checkpoint of something else (UserError); what does later
    is returned, with ``module.stop`` as `FAILED`.
    """
    record = next(callback for callback in trainer.callbacks if isinstance(callback, RunRecord))  # type: ignore[attr-defined]
    try:
        trainer.fit(module, data, ckpt_path=None if checkpoint is None else str(checkpoint))
    except (Exception, SystemExit) as error:
        if record.begun and trainer.global_step and not isinstance(error.__context__, KeyboardInterrupt):
            log.error("step %d failed, what is done will be written: %s", trainer.global_step + 1, first_line(error))
            module.stop = FAILED
            return error
        is_known = isinstance(error, (*EXPLAINED_ERRORS, SystemExit)) or mistake_of(error, plugins())
        if checkpoint is None or record.begun or is_known:
            raise
        reason = in_short(f"{type(error).__name__}: {error}")
        raise UserError(f"resume: {checkpoint} does not fit its own settings ({reason}); start anew") from error
    return None


def conclude(module: Any, folder: Path | None, cfg: DictConfig, failure: BaseException | None, steps: int) -> None:
    """End a fit of which all that it leaves is on disk, if anything; now its checkpoint goes, if it came to its end.

    Raises KeyboardInterrupt if it was interrupted, a UserError if it diverged, or the ``failure``.
    """
    if module.stop == INTERRUPTED:
        if folder is not None and (folder / CHECKPOINT).exists():
            resume = f"brushexp {'' if cfg.task == 'paint' else f'task={cfg.task} '}resume={folder}"
            log.warning("interrupted at step %d; continue with: %s", steps, resume)
        elif folder is not None:
            log.warning("interrupted at step %d; %s has what was done, and starts anew", steps, folder)
        raise KeyboardInterrupt
    if failure is not None:
        raise failure
    if module.stop == DIVERGED:
        kept = "" if folder is None else f"{folder} has what was there before it; "
        raise UserError(f"{module.trouble}; {kept}lower the rate, or choose others")
    if folder is not None:
        (folder / CHECKPOINT).unlink(missing_ok=True)
