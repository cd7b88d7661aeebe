"""Hand the config over to its task; here a run ends, whatever ends it."""

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

from brushexp.compat.hidden_packages import hidden
from brushexp.config.check import check
from brushexp.config.tasks import TASKS
from brushexp.errors import UserError
from brushexp.plugin_errors import naming_plugins
from brushexp.registry import plugins
from brushexp.results.runs import objective_in
from brushexp.runs.run_folder import lock, release, take_job
from brushexp.runs.sweep_report import note_failure
from brushexp.system.files import write_json
from brushexp.system.run_files import METRICS_FILE
from brushexp.system.runtime import cores, forget_peak_memory, pass_signal_on, peak_memory, was_signalled

NO_MEMORY = ("can't allocate memory", "not enough memory", "Unable to allocate")  # what torch and NumPy say
SIZES = ("resolution", "strokes", "batch_size", "n")  # keys that less memory is needed with

log = logging.getLogger(__name__)


def run_task(cfg: DictConfig, start: float) -> dict[str, object] | float:
    """Run ``cfg.task`` and return its numbers, or the one that ``objective`` names.

    ``start`` is `time.monotonic` when the program started.
    """
    hydra = HydraConfig.get()
    if hydra.mode is RunMode.MULTIRUN:
        return run_job_of_sweep(cfg, hydra)
    try:  # `RunFolder` has checked the config and taken the folder
        return run_in(Path(hydra.runtime.output_dir).resolve(), cfg, start)
    except UserError as error:
        log.error(error)
        raise SystemExit(1) from error


def run_job_of_sweep(cfg: DictConfig, hydra: HydraConf) -> dict[str, object] | float:
    """Run a job, whose time counts from now; the others go on if it fails, and its metrics.json says why.

    An interruption, of which Hydra tells no callback, ends the sweep.
    """
    start, folder, sweep = time.monotonic(), Path(hydra.runtime.output_dir).resolve(), Path(hydra.sweep.dir).resolve()
    forget_peak_memory()
    lock(folder)
    try:
        check(cfg, list(hydra.overrides.task))
        take_job(folder, cfg, sweep)
        result = run_in(folder, cfg, start)
    except BaseException as error:
        note_failure(folder, error)
        if isinstance(error, KeyboardInterrupt):
            log.warning("to go on with this sweep, type the same and: output=%s resume=sweep", hydra.sweep.dir)
            pass_signal_on()
        raise
    finally:
        release(folder)
    if was_signalled():  # in its last step: this job is done, and the sweep ends
        raise KeyboardInterrupt
    return result


def run_in(folder: Path, cfg: DictConfig, start: float) -> dict[str, object] | float:
    """Run the task of a checked config in a folder that is taken."""
    with hidden("scipy", "matplotlib"):
        task = importlib.import_module(TASKS[cfg.task].module)
    logging.getLogger("lightning.pytorch").setLevel(logging.WARNING)  # else it reports its hardware on every run
    if not gc.isenabled():  # until its first job, the program has disabled it
        gc.freeze()  # what is loaded now stays
        gc.enable()
    torch.set_num_threads(cfg.threads or fair_share(HydraConfig.get()))
    result = perform(task, cfg, folder, start)
    return result if cfg.objective is None else objective_in(result, cfg.objective)


def perform(task: ModuleType, cfg: DictConfig, folder: Path, start: float) -> dict[str, object]:
    """Run a task in its folder, and write its numbers as ``metrics.json``, unless it has done that itself."""
    with explaining_to_users(cfg):
        result: dict[str, object] = task.run(cfg, folder, start)
        if "status" not in result:
            spent = {"seconds_total": time.monotonic() - start, "peak_memory_mb": peak_memory()}
            result |= {**spent, "status": "completed"}
            write_json(folder / METRICS_FILE, result)
        return result


@contextmanager
def explaining_to_users(cfg: DictConfig) -> Iterator[None]:
    """Make what a user can mend a UserError: no memory, a full disk, or a plugin."""
    try:
        with naming_plugins(plugins()):
            yield
    except BaseException as error:
        if (reason := in_users_words(error, cfg)) is error:
            raise
        raise reason from error


def in_users_words(error: BaseException, cfg: DictConfig) -> BaseException:
    """What a user can mend as a UserError, and an interruption, which Lightning makes a SystemExit, as what it is."""
    if isinstance(error, SystemExit):
        was_interrupted = isinstance(error.__context__, KeyboardInterrupt)
        return (
            KeyboardInterrupt()
            if was_interrupted
            else UserError(f"something ends the program (exit code {error.code})")
        )
    if isinstance(error, MemoryError | torch.OutOfMemoryError) or any(text in str(error) for text in NO_MEMORY):
        smaller = " or ".join(f"{key}=" for key in SIZES if key in cfg)
        return UserError(f"there is not enough memory; take a smaller {smaller}")
    if isinstance(error, OSError) and error.filename is None and error.errno is not None:
        return UserError(f"cannot write into {cfg.output}: {error.strerror}; choose another folder with output=...")
    return error


def fair_share(hydra: HydraConf) -> int:
    """Cores for this job: all, or as many as a parallel launcher leaves each of its jobs."""
    all_of_them = cores()
    if "cpus_per_task" in hydra.launcher:  # of submitit, where it is one by default, as for Slurm
        return min(all_of_them, hydra.launcher.cpus_per_task or 1)
    jobs = hydra.launcher.get("n_jobs", 1) or 1
    jobs = all_of_them + 1 + jobs if jobs < 0 else jobs  # joblib and Dask: -1 means all cores
    return max(1, all_of_them // max(1, jobs))
