"""Hydra launcher ``dask``: the jobs of a sweep on the workers of a Dask cluster, each in a process of its own."""

import logging
import os
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from hydra.core.config_store import ConfigStore
from hydra.core.singleton import Singleton
from hydra.core.utils import JobReturn, configure_log, filter_overrides, setup_globals
from hydra.plugins.launcher import Launcher
from hydra.types import HydraContext, TaskFunction
from omegaconf import DictConfig

log = logging.getLogger(__name__)


@dataclass
class DaskLauncherConf:
    """Options of ``hydra/launcher=dask``."""

    _target_: str = "hydra_plugins.brushexp_dask.DaskLauncher"
    address: str | None = None  # of the scheduler, tcp://host:8786; null: workers on this machine, for this sweep
    n_jobs: int = -1  # jobs at once on a machine, that share its cores; -1 = one per core


if find_spec("distributed"):  # the extra `dask`
    ConfigStore.instance().store(group="hydra/launcher", name="dask", node=DaskLauncherConf, provider="brushexp")


class DaskLauncher(Launcher):
    """Sends jobs to workers of one thread each: what Hydra knows of a job is one for a whole process."""

    def __init__(self, address: str | None, n_jobs: int) -> None:
        self.address, self.n_jobs = address, n_jobs

    def setup(self, *, hydra_context: HydraContext, task_function: TaskFunction, config: DictConfig) -> None:
        """As in Hydra."""
        self.hydra_context, self.task_function, self.config = hydra_context, task_function, config

    def launch(self, job_overrides: Sequence[Sequence[str]], initial_job_idx: int) -> Sequence[JobReturn]:
        """Run the jobs, and wait for all of them."""
        from distributed import Client, LocalCluster  # noqa: PLC0415

        from brushexp.errors import UserError  # noqa: PLC0415

        setup_globals()
        configure_log(self.config.hydra.hydra_logging, self.config.hydra.verbose)
        logging.getLogger("distributed").setLevel(logging.WARNING)  # it tells of every worker that it starts
        logging.getLogger("asyncio").setLevel(logging.CRITICAL)  # at Ctrl-C it tells of what nobody waits for any more
        Path(self.config.hydra.sweep.dir).mkdir(parents=True, exist_ok=True)
        cores = os.cpu_count() or 1
        workers = min(len(job_overrides), self.n_jobs if self.n_jobs > 0 else cores + 1 + self.n_jobs)
        with ExitStack() as stack:
            cluster = self.address or stack.enter_context(
                LocalCluster(n_workers=workers, threads_per_worker=1, dashboard_address=None)
            )
            client = stack.enter_context(Client(cluster))
            if any(threads > 1 for threads in client.nthreads().values()):
                raise UserError(
                    f"a worker at {self.address} has several threads; start it with dask worker --nthreads 1"
                )
            common = (self.hydra_context, self.config, self.task_function)
            state = Singleton.get_state()
            futures = []
            for number, words in enumerate(job_overrides, initial_job_idx):
                log.info("\t#%d : %s", number, " ".join(filter_overrides(words)))
                futures.append(client.submit(_work, state, number, list(words), *common, pure=False))
            results: list[JobReturn] = client.gather(futures)
            return results


def _work(state: Any, *job: Any) -> JobReturn:
    """Run a job in a process that knows nothing of Hydra yet."""
    from brushexp.runs.sweep_jobs import execute_job  # noqa: PLC0415

    setup_globals()
    Singleton.set_state(state)
    return execute_job(*job)
