"""Hand the config over to its task."""

import gc
import importlib
import logging
import os
import time
import warnings

import torch
from hydra.conf import HydraConf
from hydra.core.hydra_config import HydraConfig
from hydra.types import RunMode
from omegaconf import DictConfig

from brushexp.app.composition import check
from brushexp.errors import UserError

log = logging.getLogger(__name__)


def run_task(cfg: DictConfig, start: float) -> dict[str, object]:
    """Run ``cfg.task`` and return its numbers; ``start`` is `time.monotonic` when the program started."""
    hydra = HydraConfig.get()
    if hydra.mode is RunMode.MULTIRUN:
        start = time.monotonic()  # each job counts from its own start
    task = importlib.import_module(f"brushexp.app.tasks.{cfg.task}")
    gc.freeze()  # what is loaded now stays
    gc.enable()  # run.py has disabled it
    logging.getLogger("lightning.pytorch").setLevel(logging.WARNING)  # else it reports its hardware on every run
    warnings.filterwarnings("ignore", ".*in eval mode at the start of training")  # networks are frozen on purpose
    try:
        check(cfg, list(hydra.overrides.task))
        torch.set_num_threads(cfg.threads or fair_share(hydra))
        result: dict[str, object] = task.run(cfg, start)
        return result
    except UserError as error:
        if hydra.mode is RunMode.MULTIRUN:
            raise  # the other jobs go on, and this one is marked in the table
        log.error(error)
        raise SystemExit(1) from error


def fair_share(hydra: HydraConf) -> int:
    """Cores for this job: all, or as many as a parallel launcher leaves each of its jobs."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    jobs = hydra.launcher.get("n_jobs", 1) or 1
    jobs = cores + 1 + jobs if jobs < 0 else jobs  # joblib: -1 means all cores
    return max(1, cores // max(1, jobs))
