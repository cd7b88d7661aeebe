"""Make the Lightning Trainer of a task, fit a module, and conclude the fit."""

import logging
import warnings
from collections.abc import Sequence
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import Any

import lightning as L
import torch
from lightning.pytorch.loggers import Logger
from lightning.pytorch.profilers import PassThroughProfiler
from omegaconf import DictConfig

from brushexp.compat.hidden_packages import REMARKS
from brushexp.errors import UserError, first_line
from brushexp.registry import take_built
from brushexp.registry.blame import EXPLAINED_ERRORS, mistake_of
from brushexp.runs.closing import how_to_go_on
from brushexp.runs.resume import RunRecord
from brushexp.system.callbacks import ProgressBar, TimedCheckpoint
from brushexp.system.files import write_text
from brushexp.system.reading import shorten_value
from brushexp.system.run_files import CHECKPOINT
from brushexp.system.status import Status
from brushexp.system.terminal import as_shown

PROFILE = "profile.txt"  # file that trainer.profiler=simple writes

log = logging.getLogger(__name__)


class NoProfiler(PassThroughProfiler):
    """A profiler that does nothing; Lightning's default profiler enters forty generator contexts per step."""

    nothing = nullcontext()

    def profile(self, action_name: str) -> AbstractContextManager[None]:  # type: ignore[override]
        return self.nothing


def make_trainer(
    cfg: DictConfig, device: torch.device, folder: Path | None, loggers: Sequence[Logger],
    callbacks: Sequence[L.Callback] = (), *, checkpoints: bool = True, clips: bool = True, **options: Any,
) -> L.Trainer:  # fmt: skip
    """Make a Trainer that shows a progress bar, stops cleanly at Ctrl-C, and writes ``checkpoints`` into ``folder``.

    The Trainer uses three keys of ``cfg``: ``trainer``, which overrides ``options``; ``checkpoint_every``; and, if a
    folder is given, ``callbacks``. With ``clips=False`` it does not clip gradients; modules with manual optimisation
    must clip their own. Raises a UserError if Lightning rejects an option.
    """
    chosen = [take_built(node).open(folder) for node in cfg.callbacks.values()] if folder else []
    warnings.filterwarnings("ignore", REMARKS)
    path = None if folder is None or not checkpoints else folder / CHECKPOINT
    own = [RunRecord(cfg, folder), ProgressBar(), ProfileFile(folder)]
    own.append(TimedCheckpoint(path, cfg.get("checkpoint_every")))
    cuda = device.type == "cuda"
    typed = {str(key): value for key, value in cfg.trainer.items() if value is not None}
    if not clips:
        typed = {key: value for key, value in typed.items() if not key.startswith("gradient_clip_")}
    all_options: dict[str, Any] = {"profiler": NoProfiler(), "max_epochs": -1} | options | typed
    try:
        return L.Trainer(
            accelerator="gpu" if cuda else "cpu",
            devices=[device.index or 0] if cuda else 1,
            default_root_dir=folder,
            logger=list(loggers),
            callbacks=[*callbacks, *chosen, *own],
            **all_options,
        )
    except Exception as error:  # options in a checkpoint may be anything
        raise UserError(f"trainer: {error}; see the options of Lightning's Trainer") from error


class ProfileFile(L.Callback):
    """A callback that writes the profiler's table, which Lightning only logs, to ``profile.txt``."""

    def __init__(self, folder: Path | None) -> None:
        self.folder = folder

    def on_fit_end(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        table = trainer.profiler.summary()  # type: ignore[attr-defined]
        if table and self.folder is not None:
            write_text(self.folder / PROFILE, table)
            log.info("%s  time spent in each part", as_shown(self.folder / PROFILE))


def fit(trainer: L.Trainer, module: Any, data: Any = None, checkpoint: Path | None = None) -> BaseException | None:
    """Fit a module, resuming from ``checkpoint`` if given; the caller then writes the results and calls `conclude`.

    An error before the first step is raised. A later error is returned, and ``module.stop`` becomes `Status.FAILED`.
    """
    record = next(callback for callback in trainer.callbacks if isinstance(callback, RunRecord))  # type: ignore[attr-defined]
    try:
        trainer.fit(module, data, ckpt_path=None if checkpoint is None else str(checkpoint))
    except (Exception, SystemExit) as error:
        if record.begun and trainer.global_step and not isinstance(error.__context__, KeyboardInterrupt):
            log.error("step %d failed, results so far will be written: %s", trainer.global_step + 1, first_line(error))
            module.stop = Status.FAILED
            return error
        is_known = isinstance(error, (*EXPLAINED_ERRORS, SystemExit)) or mistake_of(error)
        if checkpoint is None or record.begun or is_known:
            raise
        reason = shorten_value(f"{type(error).__name__}: {error}")
        raise UserError(f"resume: {checkpoint} does not fit its own settings ({reason}); start a new run") from error
    return None


def conclude(module: Any, folder: Path | None, cfg: DictConfig, failure: BaseException | None, steps: int) -> None:
    """Conclude a fit whose results have been written: remove the checkpoint, or raise the error that ended the fit."""
    if module.stop == Status.INTERRUPTED:
        if folder is not None and (folder / CHECKPOINT).is_file():
            raise KeyboardInterrupt(f"interrupted at step {steps}; {how_to_go_on(folder, cfg.task)}")
        raise KeyboardInterrupt  # the runner reports the files
    if failure is not None:
        raise failure
    if module.stop == Status.DIVERGED:
        place = "" if folder is None else f"{folder} has the result before it; "
        raise UserError(f"{module.trouble}; {place}lower the rate, or choose others")
    if folder is not None:
        (folder / CHECKPOINT).unlink(missing_ok=True)
