"""Hydra's ``processes`` launcher: run a sweep's jobs in parallel, in forks of this process with all modules loaded."""

import ctypes
import os
import signal
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from multiprocessing import connection, get_context

from hydra.core.config_store import ConfigStore
from hydra.core.utils import JobReturn
from hydra.plugins.launcher import Launcher
from hydra.types import HydraContext, TaskFunction
from hydra_plugins.brushexp_jobs import execute_job, number_jobs
from omegaconf import DictConfig

PR_SET_PDEATHSIG = 1  # option of prctl(2)
Pipe = connection.Connection


@dataclass
class ProcessesLauncherConf:
    """Options of ``hydra/launcher=processes``, the launcher that ``jobs=`` selects."""

    _target_: str = "hydra_plugins.brushexp_processes.ProcessesLauncher"
    n_jobs: int = -1  # number of concurrent jobs, which share the cores; -1 = one per core


def works_here() -> bool:
    """Check whether this process may be forked; libraries support forking only on Linux, and CUDA not at all."""
    from brushexp.contracts.machine import device_of  # noqa: PLC0415  (torch)

    return sys.platform == "linux" and device_of("auto").type == "cpu"


if sys.platform == "linux":
    ConfigStore.instance().store(
        group="hydra/launcher", name="processes", node=ProcessesLauncherConf, provider="brushexp"
    )


class ProcessesLauncher(Launcher):
    """Launcher that runs jobs in parallel, as Hydra's joblib launcher does, but loads modules and kernels only once."""

    def __init__(self, n_jobs: int) -> None:
        self.n_jobs = n_jobs

    def setup(self, *, hydra_context: HydraContext, task_function: TaskFunction, config: DictConfig) -> None:
        import torch  # noqa: PLC0415

        self.hydra_context, self.task_function, self.config = hydra_context, task_function, config
        torch.set_num_threads(1)  # a fork would wait forever for OpenMP's threads

    def launch(self, job_overrides: Sequence[Sequence[str]], initial_job_idx: int) -> Sequence[JobReturn]:
        """Run all jobs and wait for them; the sweep ends if a job's process dies."""
        from brushexp.contracts.machine import jobs_at_once  # noqa: PLC0415

        jobs = number_jobs(self.config, job_overrides, initial_job_idx)
        with self._forks(min(len(jobs), jobs_at_once(self.n_jobs))) as pipes:
            results = _results(pipes, jobs)
        return [results[number] for number in jobs]

    @contextmanager
    def _forks(self, count: int) -> Iterator[list[Pipe]]:
        """Start processes that run the jobs sent to them; on exit, wait for the processes to end."""
        fork, processes, pipes = get_context("fork"), [], list[Pipe]()
        for _ in range(count):
            here, there = fork.Pipe()
            processes.append(fork.Process(target=self._serve, args=(there, os.getpid(), [*pipes, here])))
            processes[-1].start()
            there.close()  # lets this process notice when the fork ends
            pipes.append(here)
        try:
            yield pipes
            for pipe in pipes:
                pipe.send(None)
        except BaseException:
            for process, pipe in zip(processes, pipes, strict=True):
                pipe.close()  # otherwise a fork that misses the signal waits for a job, and we wait for it
                with suppress(ProcessLookupError):
                    os.kill(process.pid or 0, signal.SIGINT)
            raise
        finally:
            for process in processes:
                process.join()

    def _serve(self, pipe: Pipe, parent: int, of_parent: Sequence[Pipe]) -> None:
        """Run jobs in a fork until no more are sent, or until the parent process dies or closes its pipe."""
        for other in of_parent:
            other.close()  # leaves the ends of other pipes to the parent alone
        os.setpgrp()  # lets Ctrl-C arrive only from the parent, not from the terminal
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGINT)
        with suppress(KeyboardInterrupt, EOFError, ConnectionError):
            while os.getppid() == parent and (job := pipe.recv()) is not None:
                number, words = job
                result = execute_job(number, words, self.hydra_context, self.config, self.task_function)
                pipe.send(replace(result, cfg=None, hydra_cfg=None))  # some configs cannot be pickled


def _results(pipes: Sequence[Pipe], jobs: dict[int, list[str]]) -> dict[int, JobReturn]:
    """Send a job to each process, and the next job whenever a process is idle; return the results by job number."""
    from brushexp.contracts import UserError  # noqa: PLC0415

    queue, idle, at_work, results = list(jobs), list(pipes), dict[Pipe, int](), dict[int, JobReturn]()
    while queue or at_work:
        while queue and idle:
            pipe, number = idle.pop(), queue.pop(0)
            pipe.send((number, jobs[number]))
            at_work[pipe] = number
        ready = connection.wait(list(at_work))
        for pipe in [one for one in at_work if one in ready]:
            number = at_work.pop(pipe)
            try:
                results[number] = pipe.recv()
            except EOFError as error:
                raise UserError(f"job {number} has ended without a result; continue with resume=sweep") from error
            idle.append(pipe)
    return results
