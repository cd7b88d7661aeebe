"""The Lightning Trainer of a task, with the device, options and callbacks of its config; an interrupted fit goes on."""

import logging
import os
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import lightning as L
import torch
from hydra.core.hydra_config import HydraConfig
from lightning.pytorch.loggers import Logger
from omegaconf import DictConfig, OmegaConf

from brushexp.config.check import check, leaves
from brushexp.config.keys import typed
from brushexp.config.tasks import TASKS
from brushexp.errors import UserError
from brushexp.plugin_errors import SAID_ALREADY, mistake_of
from brushexp.registry import plain_config, plugins, take_built
from brushexp.results.runs import words_of
from brushexp.runs.run_folder import note_words
from brushexp.runs.sweep_report import first_line
from brushexp.system.callbacks import DIVERGED, FAILED, INTERRUPTED, ProgressBar, TimedCheckpoint
from brushexp.system.reading import check_plain, digest_of, in_short, read_pickled
from brushexp.system.run_files import CHECKPOINT

log = logging.getLogger(__name__)

RECORD = "brushexp"  # key of the settings in it
OVERRIDABLE = ("output", "overwrite", "resume", "device", "threads", "checkpoint_every")  # may change in a resumed run


def trainer_of(
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
        is_known = isinstance(error, (*SAID_ALREADY, SystemExit)) or mistake_of(error, plugins())
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


class RunRecord(L.Callback):
    """Puts the settings of a run into its checkpoints, and the digests of the files that they name."""

    def __init__(self, cfg: DictConfig, folder: Path | None) -> None:
        self.record = {} if folder is None else record_of(cfg, folder)  # without a folder there are no checkpoints
        self.begun = False

    def on_train_batch_end(self, *_: object) -> None:
        self.begun = True  # what a checkpoint holds has been used

    def on_save_checkpoint(self, trainer: L.Trainer, pl_module: L.LightningModule, checkpoint: dict[str, Any]) -> None:
        checkpoint[RECORD] = self.record


def interrupted_run(folder: Path, cfg: DictConfig) -> tuple[Path, DictConfig]:
    """Checkpoint and settings of a run that is to be continued.

    A checkpoint may be a stranger's: nothing in it is run, and its settings are plain values. It is refused (UserError)
    where the command line changes what must stay, or a file or set that the run began with is another now.
    """
    path = folder / CHECKPOINT
    chosen = {override.lstrip("+~").partition("=")[0]: override for override in HydraConfig.get().overrides.task}
    try:
        record = read_pickled(path, "start anew")[RECORD]
        kept = plain_config(record["settings"])
        words = [str(word) for word in check_plain(record["words"])]
        for key, override in chosen.items():
            if key not in (*OVERRIDABLE, "task") and override not in words:
                raise UserError(f"a run goes on with its own settings; drop {override}")
        paths = {key: (Path(name), digest) for key, (name, digest) in check_plain(record["files"]).items()}
        if not paths.keys() <= {key for key, value in leaves(record["settings"]) if isinstance(value, str)}:
            raise UserError(f"{path} names files that its settings do not name; start anew")
        if kept.task != cfg.task:
            raise UserError(f"this is a run of task={kept.task}; add task={kept.task}")
        kept = typed(TASKS[kept.task], kept)
        for key, (file, digest) in paths.items():
            if not file.is_file() or digest_of(file) != digest:
                raise UserError(f"{key}={file} is not the file that the run began with; put it back")
            if file.suffix:  # else it may be a name that means something else
                OmegaConf.update(kept, key, str(file))  # this folder may be another
        kept.merge_with({key: cfg[key] for key in OVERRIDABLE if key in chosen})
        kept.merge_with({"output": cfg.output, "resume": str(folder)})
        check(kept)
        sets = kept.get("data") or []
        for name, begun, now in zip(sets, check_plain(record["sets"]), strokes_and_seeds(sets), strict=False):
            if list(begun) != now:
                there = f"{now[0]} strokes of seed {now[1]} now, and the run began with {begun[0]} of seed {begun[1]}"
                raise UserError(f"data={name} has {there}; put it back, or start anew")
    except UserError as error:
        raise UserError(f"resume={folder}: {error}") from error
    except Exception as error:  # of whatever it holds instead
        reason = in_short(f"{type(error).__name__}: {error}")
        raise UserError(f"resume={folder}: {path} is no checkpoint of this program ({reason}); start anew") from error
    if kept.threads:  # the command line of this run need not say so, and networks round otherwise on others
        torch.set_num_threads(kept.threads)
    note_words(Path(HydraConfig.get().runtime.output_dir), kept, words)  # of the whole run, not of what continues it
    return path, kept


def record_of(cfg: DictConfig, folder: Path) -> dict[str, Any]:
    """What a checkpoint tells of its run: its settings, files and sets that they name, and the words typed."""
    settings: Any = OmegaConf.to_container(cfg, resolve=True, enum_to_str=True)
    sets = strokes_and_seeds(settings.get("data") or [])
    return {"settings": settings, "files": digests(settings), "sets": sets, "words": words_of(folder)}


def strokes_and_seeds(sets: Sequence[str]) -> list[list[int]]:
    """How many strokes each set has, and their seed: a set that has grown begins as before, but is shuffled anew."""
    from brushexp.training.dataset import StrokeSet  # noqa: PLC0415  (painting has none)

    return [[len(strokes), strokes.seed] for strokes in (StrokeSet(Path(path)) for path in sets)]


def digests(settings: Any) -> dict[str, tuple[str, str]]:
    """Of all files that settings name: key -> path and digest."""
    named = [(key, Path(value)) for key, value in leaves(settings) if isinstance(value, str) and os.path.isfile(value)]
    return {key: (str(path.resolve()), digest_of(path)) for key, path in named}
