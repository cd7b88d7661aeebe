"""Number the jobs of a sweep and run one job, for launchers that use several processes."""

import logging
from collections.abc import Sequence
from pathlib import Path

from hydra.core.hydra_config import HydraConfig
from hydra.core.utils import JobReturn, configure_log, filter_overrides, run_job, setup_globals
from hydra.types import HydraContext, TaskFunction
from omegaconf import DictConfig, open_dict

log = logging.getLogger(__name__)


def number_jobs(config: DictConfig, jobs: Sequence[Sequence[str]], first: int) -> dict[int, list[str]]:
    """Number and log the jobs that a launcher starts, create the sweep's folder, and return the jobs by number."""
    setup_globals()
    configure_log(config.hydra.hydra_logging, config.hydra.verbose)
    Path(config.hydra.sweep.dir).mkdir(parents=True, exist_ok=True)
    numbered = {number: list(job) for number, job in enumerate(jobs, first)}
    for number, job in numbered.items():
        log.info("\t#%d : %s", number, " ".join(filter_overrides(job)))
    return numbered


def execute_job(
    number: int, words: list[str], context: HydraContext, config: DictConfig, task_function: TaskFunction
) -> JobReturn:
    """Run a job of a sweep in this process."""
    job = context.config_loader.load_sweep_config(config, words)
    with open_dict(job):
        job.hydra.job.id, job.hydra.job.num = f"{job.hydra.job.name}_{number}", number
    HydraConfig.instance().set_config(job)
    return run_job(
        hydra_context=context,
        config=job,
        task_function=task_function,
        job_dir_key="hydra.sweep.dir",
        job_subdir_key="hydra.sweep.subdir",
    )
