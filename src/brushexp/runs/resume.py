"""Restore an interrupted run from its checkpoint, and check that its inputs are unchanged."""

import logging
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import lightning as L
from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig, OmegaConf

from brushexp.config.changes import shorten_words
from brushexp.config.check import check, leaves
from brushexp.config.keys import with_types
from brushexp.config.tasks import TASKS
from brushexp.errors import UserError
from brushexp.registry import plain_config
from brushexp.results.provenance import differing_parts
from brushexp.results.runs import words_of
from brushexp.runs.provenance import provenance_of
from brushexp.runs.run_folder import note_words
from brushexp.system.earlier import todays_key, todays_settings
from brushexp.system.reading import check_format_version, check_plain, digest_of
from brushexp.system.reading_tensors import read_pickled
from brushexp.system.run_files import CHECKPOINT
from brushexp.system.runtime import use_threads

RECORD_KEY = "brushexp"  # key of the settings in a checkpoint
VERSION = 1  # version of that record; increase it if new records would mislead older programs
OVERRIDABLE = ("output", "overwrite", "resume", "device", "threads", "checkpoint_every")  # keys that may change
log = logging.getLogger(__name__)


def restore_run(cfg: DictConfig) -> tuple[DictConfig, Path | None]:
    """Return the settings and checkpoint of the run that ``resume`` names, or ``cfg`` and None if it is not set."""
    return (cfg, None) if cfg.get("resume") is None else interrupted_run(Path(cfg.resume), cfg)


class RunRecord(L.Callback):
    """A callback that stores a run's settings in its checkpoints, with digests of the files that the settings name."""

    def __init__(self, cfg: DictConfig, folder: Path | None) -> None:
        self.record = {} if folder is None else record_of(cfg, folder)  # runs without a folder have no checkpoints
        self.begun = False

    def on_train_batch_end(self, *_: object) -> None:
        self.begun = True  # the checkpoint has been used

    def on_save_checkpoint(self, trainer: L.Trainer, pl_module: L.LightningModule, checkpoint: dict[str, Any]) -> None:
        checkpoint[RECORD_KEY] = self.record


def interrupted_run(folder: Path, cfg: DictConfig) -> tuple[DictConfig, Path]:
    """Return the settings and checkpoint of an interrupted run.

    The checkpoint is untrusted: nothing in it is executed, and its settings are plain values. Raises a UserError if the
    command line changes a setting that must stay the same, or if an input has changed since the run began.
    """
    path = folder / CHECKPOINT
    try:
        record = read_pickled(path, "start anew")[RECORD_KEY]
        check_format_version(record.get("format_version", VERSION), VERSION)
        settings = plain_config(todays_settings(record["settings"]))
        words = [str(word) for word in check_plain(record["words"])]
        chosen = _chosen_keys(words)
        task = settings.get("task")
        if task not in TASKS:
            raise UserError("its settings do not name a task; start a new run")
        if task != cfg.task:
            raise UserError(f"this is a run of task={task}; add task={task}")
        settings = with_types(TASKS[task], settings)
        _check_files(path, record, settings)
        settings.merge_with({key: cfg[key] for key in OVERRIDABLE if key in chosen})
        settings.merge_with({"output": cfg.output, "resume": str(folder)})
        check(settings)
        _check_inputs(check_plain(record.get("inputs", {})), TASKS[task].inputs(settings))
        _warn_of_differences(folder, check_plain(record.get("provenance")), settings)
    except UserError as error:
        raise UserError(f"resume={folder}: {error}") from error
    except Exception as error:  # the file may contain anything
        raise UserError(f"resume={folder}: {path} is not a checkpoint of this program; start a new run") from error
    if settings.threads:  # the command line need not repeat it; the number of threads affects rounding in networks
        use_threads(settings.threads)
    note_words(Path(HydraConfig.get().runtime.output_dir), settings, words)  # the words of the whole run
    return settings, path


def _chosen_keys(words: Sequence[str]) -> set[str]:
    """Return the keys set on the command line; raise a UserError if one would change a fixed setting.

    ``words`` are the run's original arguments, which may be repeated.
    """
    chosen = {override.lstrip("+~").partition("=")[0]: override for override in HydraConfig.get().overrides.task}
    for key, override in chosen.items():
        if key not in (*OVERRIDABLE, "task") and override not in words:
            raise UserError(f"a resumed run keeps its own settings; drop {shorten_words([override])[0]}")
    return set(chosen)


def _check_files(path: Path, record: Any, settings: DictConfig) -> None:
    """Raise a UserError if a recorded file is missing or has changed; set the files' absolute paths in the settings."""
    files = {key: (Path(name), digest) for key, (name, digest) in check_plain(record["files"]).items()}
    if not files.keys() <= {key for key, value in leaves(record["settings"]) if isinstance(value, str)}:
        raise UserError(f"{path} lists files that its settings do not name; start a new run")
    for key, (file, digest) in files.items():
        if not file.is_file() or digest_of(file) != digest:
            raise UserError(f"{key}={file} has changed since the run began; restore it")
        if file.suffix:  # otherwise it may name a shipped file; the working folder may have changed
            OmegaConf.update(settings, todays_key(key, record["settings"]), str(file))


def _check_inputs(before: dict[str, str], now: dict[str, str]) -> None:
    """Raise a UserError if an input has changed since the run began."""
    for name, is_now in now.items():
        if before.get(name) != is_now:
            raise UserError(f"{name} has {is_now} now, but the run began with {before.get(name)}; restore it")


def _warn_of_differences(folder: Path, before: Any, settings: DictConfig) -> None:
    """Warn if versions, plugin files or hardware differ from those recorded when the run began."""
    if isinstance(before, dict) and (parts := differing_parts([before, provenance_of(settings)])):
        line = "resume=%s continues in a different environment (%s); for a comparable run, start a new one"
        log.warning(line, folder, "; ".join(parts))


def record_of(cfg: DictConfig, folder: Path) -> dict[str, Any]:
    """Return a checkpoint's record of a run: settings, digests of files, other inputs, arguments and provenance."""
    settings: Any = OmegaConf.to_container(cfg, resolve=True, enum_to_str=True)
    paths = {key: Path(value) for key, value in leaves(settings) if isinstance(value, str) and os.path.isfile(value)}
    files = {key: (str(path.resolve()), digest_of(path)) for key, path in paths.items()}
    inputs = TASKS[cfg.task].inputs(cfg)
    return {
        "format_version": VERSION,
        "settings": settings,
        "files": files,
        "inputs": inputs,
        "words": words_of(folder),
        "provenance": provenance_of(cfg),
    }
