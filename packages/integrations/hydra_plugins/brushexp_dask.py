"""Hydra's ``dask`` launcher: run the jobs of a sweep on the workers of a Dask cluster, each in its own process."""

import logging
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Any

from hydra.core.config_store import ConfigStore
from hydra.core.singleton import Singleton
from hydra.core.utils import JobReturn, setup_globals
from hydra.plugins.launcher import Launcher
from hydra.types import HydraContext, TaskFunction
from hydra_plugins.brushexp_jobs import execute_job, number_jobs
from omegaconf import DictConfig


@dataclass
class DaskLauncherConf:
    """Options of ``hydra/launcher=dask``."""

    _target_: str = "hydra_plugins.brushexp_dask.DaskLauncher"
    address: str | None = None  # scheduler's address, tcp://host:8786; null = workers on this machine for this sweep
    n_jobs: int = -1  # number of concurrent jobs per machine, which share its cores; -1 = one per core


if find_spec("distributed"):  # installed with the extra `dask`
    ConfigStore.instance().store(group="hydra/launcher", name="dask", node=DaskLauncherConf, provider="brushexp")


class DaskLauncher(Launcher):
    """Launcher that runs jobs on workers with one thread each, because Hydra's state is global to a process."""

    def __init__(self, address: str | None, n_jobs: int) -> None:
        self.address, self.n_jobs = address, n_jobs

    def setup(self, *, hydra_context: HydraContext, task_function: TaskFunction, config: DictConfig) -> None:
        self.hydra_context, self.task_function, self.config = hydra_context, task_function, config

    def launch(self, job_overrides: Sequence[Sequence[str]], initial_job_idx: int) -> Sequence[JobReturn]:
        """Run all jobs and wait for them."""
        from distributed import Client, LocalCluster  # noqa: PLC0415

        from brushexp.contracts import UserError  # noqa: PLC0415
        from brushexp.contracts.machine import jobs_at_once  # noqa: PLC0415

        jobs = number_jobs(self.config, job_overrides, initial_job_idx)
        logging.getLogger("distributed").setLevel(logging.WARNING)  # otherwise it logs the start of every worker
        logging.getLogger("distributed.nanny").setLevel(logging.ERROR)  # otherwise it logs workers that end slowly
        logging.getLogger("asyncio").setLevel(logging.CRITICAL)  # otherwise it logs futures abandoned by Ctrl-C
        workers = min(len(jobs), jobs_at_once(self.n_jobs))
        with ExitStack() as stack:
            cluster = self.address or stack.enter_context(
                LocalCluster(n_workers=workers, threads_per_worker=1, dashboard_address=None)
            )
            client = stack.enter_context(Client(cluster))
            if any(threads > 1 for threads in client.nthreads().values()):
                raise UserError(
                    f"a worker at {self.address} has several threads; start it with dask worker --nthreads 1"
                )
            common, state = (self.hydra_context, self.config, self.task_function), Singleton.get_state()
            futures = [client.submit(_work, state, *job, *common, pure=False) for job in jobs.items()]
            return client.gather(futures)


def _work(state: Any, *job: Any) -> JobReturn:
    """Run a job in a process where Hydra has not been set up."""
    setup_globals()
    Singleton.set_state(state)
    return execute_job(*job)
