"""Run the task of a config, and turn errors and interruptions into exit codes or messages."""

import gc
import importlib
import logging
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType

import torch
from hydra.conf import HydraConf
from hydra.core.hydra_config import HydraConfig
from hydra.types import RunMode
from omegaconf import DictConfig

from brushexp.compat.deferred_compiler import defer_compiler
from brushexp.compat.first_compilation import log_compilation
from brushexp.compat.hidden_packages import hide_packages
from brushexp.config.check import check
from brushexp.config.schema import ExportTask, PaintTask
from brushexp.config.tasks import TASKS
from brushexp.errors import UserError
from brushexp.registry.blame import naming_plugins
from brushexp.results.runs import objective_in
from brushexp.runs.closing import how_to_go_on
from brushexp.runs.provenance import provenance_of
from brushexp.runs.run_folder import lock, release_folder, take_job
from brushexp.runs.sweep_report import note_failure
from brushexp.system.files import write_json
from brushexp.system.heartbeat import heartbeat
from brushexp.system.run_files import METRICS_FILE
from brushexp.system.runtime import (
    cores,
    forget_peak_memory,
    jobs_at_once,
    peak_memory,
    pop_lost_interrupt,
    received_signal,
    reraise_signal,
    use_threads,
)
from brushexp.system.status import Status

NO_MEMORY = ("can't allocate memory", "not enough memory", "Unable to allocate")  # messages of PyTorch and NumPy
MEMORY_KEYS = ("resolution", "strokes", "batch_size", "n")  # keys that affect the memory of a run

log = logging.getLogger(__name__)


def run_task(cfg: DictConfig, start: float) -> dict[str, object] | float:
    """Run ``cfg.task`` and return its metrics, or only the metric named by ``cfg.objective``.

    ``start`` is the value of `time.monotonic` when the program started.
    """
    hydra = HydraConfig.get()
    if hydra.mode is RunMode.MULTIRUN:
        heartbeat.end()
        return _run_job(cfg, hydra)
    folder = Path(hydra.runtime.output_dir).resolve()
    try:  # `RunFolder` has already checked the config and taken the folder
        return _run_in(folder, cfg, start)
    except KeyboardInterrupt as interruption:
        log.warning("%s", *(interruption.args or [f"interrupted; {how_to_go_on(folder, cfg.task)}"]))
        raise
    except UserError as error:
        log.error(error)
        raise SystemExit(1) from error


def _run_job(cfg: DictConfig, hydra: HydraConf) -> dict[str, object] | float:
    """Run a job of a sweep; if it fails, record why in its metrics.json. An interruption ends the sweep."""
    start, folder, sweep = time.monotonic(), Path(hydra.runtime.output_dir).resolve(), Path(hydra.sweep.dir).resolve()
    forget_peak_memory()
    lock(folder)
    try:
        check(cfg, list(hydra.overrides.task))
        take_job(folder, cfg, sweep)
        result = _run_in(folder, cfg, start)
    except BaseException as error:
        note_failure(folder, error)
        if isinstance(error, KeyboardInterrupt):
            log.warning("interrupted; to continue, repeat the command with: output=%s resume=sweep", hydra.sweep.dir)
            reraise_signal()
        raise
    finally:
        release_folder(folder)
    if received_signal():  # interrupted in its last step: the job is finished, and the sweep ends
        raise KeyboardInterrupt
    return result


def _run_in(folder: Path, cfg: DictConfig, start: float) -> dict[str, object] | float:
    """Run the task of a checked config in its run folder."""
    with hide_packages("scipy", "matplotlib"), defer_compiler():
        task = importlib.import_module(TASKS[cfg.task].module)
    if TASKS[cfg.task] not in (PaintTask, ExportTask):  # other tasks show their own progress or wait for input
        heartbeat.end()
    logging.getLogger("lightning.pytorch").setLevel(logging.WARNING)  # otherwise it reports its hardware in every run
    if not gc.isenabled():  # the program disables it until the first job
        gc.freeze()
        gc.enable()
    use_threads(cfg.threads or _threads_per_job(HydraConfig.get()))
    if "blend" in cfg or "engine" in cfg:
        log_compilation()
    result = perform(task, cfg, folder, start)
    return result if cfg.objective is None else objective_in(result, cfg.objective)


def perform(task: ModuleType, cfg: DictConfig, folder: Path, start: float) -> dict[str, object]:
    """Run a task in its folder, and write its metrics to ``metrics.json`` unless the task itself does so."""
    with explaining_to_users(cfg):
        provenance = None if TASKS[cfg.task].writes_metrics else provenance_of(cfg)
        result: dict[str, object] = task.run(cfg, folder, start)
        if "status" not in result:
            spent = {"seconds_total": time.monotonic() - start, "peak_memory_mb": peak_memory()}
            result |= {**spent, "status": Status.COMPLETED, "provenance": provenance}
            write_json(folder / METRICS_FILE, result)
        return result


@contextmanager
def explaining_to_users(cfg: DictConfig) -> Iterator[None]:
    """Turn errors that a user can fix into a UserError: insufficient memory, a full disk, a broken plugin."""
    try:
        with naming_plugins():
            yield
    except BaseException as error:
        if (reason := _reason_of(error, cfg)) is error:
            raise
        raise reason from error


def _reason_of(error: BaseException, cfg: DictConfig) -> BaseException:
    """Return the error to raise instead of the original one; Lightning turns interruptions into SystemExit."""
    if pop_lost_interrupt():  # an interruption lost in Numba surfaces as another error
        return KeyboardInterrupt()
    if isinstance(error, SystemExit):
        if isinstance(error.__context__, KeyboardInterrupt):
            return KeyboardInterrupt()
        return UserError(f"a library ended the program (exit code {error.code})")
    if isinstance(error, MemoryError | torch.OutOfMemoryError) or any(text in str(error) for text in NO_MEMORY):
        smaller = " or ".join(f"{key}=" for key in MEMORY_KEYS if key in cfg)
        return UserError(f"there is not enough memory; choose a smaller {smaller}")
    if isinstance(error, OSError) and error.filename is None and error.errno is not None:
        return UserError(f"cannot write into {cfg.output}: {error.strerror}; choose another folder with output=...")
    return error


def _threads_per_job(hydra: HydraConf) -> int:
    """Return the number of threads for this job: one per core, or a share of the cores if jobs run in parallel."""
    if "cpus_per_task" in hydra.launcher:  # like Slurm, submitit uses one core by default
        return min(cores(), hydra.launcher.cpus_per_task or 1)
    return max(1, cores() // jobs_at_once(hydra.launcher.get("n_jobs", 1) or 1))
