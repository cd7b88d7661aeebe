"""Hydra launcher ``processes``: jobs of a sweep at once, in forks of this process, which has loaded everything."""

import ctypes
import logging
import os
import signal
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from multiprocessing import connection, get_context
from pathlib import Path

from hydra.core.config_store import ConfigStore
from hydra.core.utils import JobReturn, configure_log, filter_overrides, setup_globals
from hydra.plugins.launcher import Launcher
from hydra.types import HydraContext, TaskFunction
from omegaconf import DictConfig

log = logging.getLogger(__name__)
PARENT_DEATH = 1  # PR_SET_PDEATHSIG of prctl(2)
Pipe = connection.Connection


@dataclass
class ProcessesLauncherConf:
    """Options of ``hydra/launcher=processes``, which ``jobs=`` chooses."""

    _target_: str = "hydra_plugins.brushexp_processes.ProcessesLauncher"
    n_jobs: int = -1  # jobs at once, that share the cores; -1 = one per core


if sys.platform == "linux":  # elsewhere libraries do not survive a fork
    ConfigStore.instance().store(
        group="hydra/launcher", name="processes", node=ProcessesLauncherConf, provider="brushexp"
    )


class ProcessesLauncher(Launcher):
    """What Hydra's joblib launcher does, without modules and kernels being loaded again by each process."""

    def __init__(self, n_jobs: int) -> None:
        self.n_jobs = n_jobs

    def setup(self, *, hydra_context: HydraContext, task_function: TaskFunction, config: DictConfig) -> None:
        """As in Hydra; and there must be no pool of OpenMP, for a fork would wait for its threads for ever."""
        import torch  # noqa: PLC0415

        self.hydra_context, self.task_function, self.config = hydra_context, task_function, config
        torch.set_num_threads(1)

    def launch(self, job_overrides: Sequence[Sequence[str]], initial_job_idx: int) -> Sequence[JobReturn]:
        """Run the jobs, and wait for all of them; a job that dies ends the sweep."""
        setup_globals()
        configure_log(self.config.hydra.hydra_logging, self.config.hydra.verbose)
        Path(self.config.hydra.sweep.dir).mkdir(parents=True, exist_ok=True)
        jobs = dict(enumerate(map(list, job_overrides), initial_job_idx))
        for number, words in jobs.items():
            log.info("\t#%d : %s", number, " ".join(filter_overrides(words)))
        cores = len(os.sched_getaffinity(0))
        count = min(len(jobs), self.n_jobs if self.n_jobs > 0 else max(1, cores + 1 + self.n_jobs))
        with self._forks(count) as pipes:
            results = _results(pipes, jobs)
        return [results[number] for number in jobs]

    @contextmanager
    def _forks(self, count: int) -> Iterator[list[Pipe]]:
        """Processes that run the jobs which are sent to them; in the end they are told to stop, and waited for."""
        fork, processes, pipes = get_context("fork"), [], list[Pipe]()
        for _ in range(count):
            here, there = fork.Pipe()
            processes.append(fork.Process(target=self._serve, args=(there, os.getpid())))
            processes[-1].start()
            there.close()  # so that its end is seen here
            pipes.append(here)
        try:
            yield pipes
            for pipe in pipes:
                pipe.send(None)
        except BaseException:
            for process in processes:
                with suppress(ProcessLookupError):
                    os.kill(process.pid or 0, signal.SIGINT)
            raise
        finally:
            for process in processes:
                process.join()

    def _serve(self, pipe: Pipe, parent: int) -> None:
        """Run jobs in a fork until there are no more; it ends as by Ctrl-C when its parent is killed."""
        from brushexp.runs.sweep_jobs import execute_job  # noqa: PLC0415

        os.setpgrp()  # so that a Ctrl-C is not told twice, by the terminal and by the parent
        ctypes.CDLL(None).prctl(PARENT_DEATH, signal.SIGINT)
        with suppress(KeyboardInterrupt, EOFError):
            while os.getppid() == parent and (job := pipe.recv()) is not None:
                number, words = job
                result = execute_job(number, words, self.hydra_context, self.config, self.task_function)
                pipe.send(replace(result, cfg=None, hydra_cfg=None))  # which not all can be sent


def _results(pipes: Sequence[Pipe], jobs: dict[int, list[str]]) -> dict[int, JobReturn]:
    """Send each process a job, and another one when it has its result; the results by the numbers of the jobs."""
    from brushexp.errors import UserError  # noqa: PLC0415

    left, idle, at_work, results = list(jobs), list(pipes), dict[Pipe, int](), dict[int, JobReturn]()
    while left or at_work:
        while left and idle:
            pipe, number = idle.pop(), left.pop(0)
            pipe.send((number, jobs[number]))
            at_work[pipe] = number
        heard = connection.wait(list(at_work))
        for pipe in [one for one in at_work if one in heard]:
            number = at_work.pop(pipe)
            try:
                results[number] = pipe.recv()
            except EOFError as error:
                raise UserError(f"job {number} has ended without a result; go on with resume=sweep") from error
            idle.append(pipe)
    return results
