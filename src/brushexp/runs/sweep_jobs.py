"""The jobs of a sweep: checked before the first starts, noted in its folder, and left out when it goes on and has them.

What sweepers of Hydra (``src/hydra_plugins``) share.
"""

import logging
import shlex
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from hydra.core.hydra_config import HydraConfig
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.utils import JobReturn, JobStatus, run_job
from hydra.types import HydraContext, TaskFunction
from omegaconf import DictConfig, OmegaConf, open_dict

from brushexp.config.check import check
from brushexp.errors import UserError
from brushexp.registry import drop_built
from brushexp.results.runs import JOBS, has_finished
from brushexp.runs.run_folder import check_free, take
from brushexp.runs.sweep_report import first_line, renew
from brushexp.system.files import write_json
from brushexp.system.reading import in_short, json_of, read_text
from brushexp.system.run_files import CHECKPOINT

ANY_TIME = ("output", "overwrite")  # keys that may be others when a sweep goes on
ENGINES = ("joblib.", "submitit.", "distributed.")  # whose errors tell of jobs that were killed
PICTURE = "image="
SUBFOLDER = "hydra.sweep.subdir="  # of the sweep's folder, where a job is
Words = Sequence[str]

log = logging.getLogger(__name__)


def check_jobs(loader: Any, config: DictConfig, jobs: Sequence[Words], lenient: bool = False) -> None:
    """Refuse (UserError) a sweep of which one job would be refused; a ``lenient`` one, of which all would be."""
    refused, known, parser = [], dict[tuple[str, ...], DictConfig](), OverridesParser.create()
    for number, job in enumerate(jobs):
        try:
            others = tuple(word for word in job if not word.startswith((PICTURE, SUBFOLDER)))
            if others not in known:  # composing takes a while, and the picture changes nothing else
                known[others] = loader.load_sweep_config(config, list(job))
            cfg = known[others].copy()
            for word in job:
                if word.startswith(PICTURE):
                    cfg.image = parser.parse_override(word).value()
            check(cfg, job)
        except UserError as error:
            refused.append(f"job {number} of the sweep ({' '.join(job)}): {error}")
            if not lenient or len(refused) == len(jobs):
                raise UserError(refused[0]) from error
    drop_built()  # each job builds its own
    for reason in refused:
        log.warning("%s; it is skipped", reason)


def begin_sweep(config: DictConfig, jobs: Sequence[Words], goes_on: bool, lenient: bool = False) -> None:
    """Take the folder of a sweep and note its jobs there; one that ``goes_on`` must have noted the same (UserError).

    A ``lenient`` one may have others, but none in the folder of one that was noted.
    """
    folder = Path(config.hydra.sweep.dir)
    kept_jobs = [kept(job) for job in jobs]
    if goes_on:
        check_same(folder, kept_jobs, lenient)
    take(folder, config, goes_on)
    write_json(folder / JOBS, {"typed": command_words(config), "jobs": kept_jobs})


def command_words(config: DictConfig) -> list[str]:
    """The command line of a sweep without its folder; ``${...}`` is left to each job."""
    typed = OmegaConf.to_container(config.hydra.overrides, resolve=False)
    words = [*typed["hydra"], *typed["task"]]  # type: ignore[call-overload,index]
    return [word for word in kept(words) if word not in ("hydra.mode=MULTIRUN", "hydra.sweeper.resume=true")]


def kept(words: Words) -> list[str]:
    """The words by which a job is recognised."""
    return [word for word in words if word.partition("=")[0] not in ANY_TIME]


def check_same(folder: Path, jobs: Sequence[Words], lenient: bool = False) -> None:
    """Refuse (UserError) to go on with a folder that is not of a sweep with just these jobs."""
    try:
        noted = json_of(read_text(folder / JOBS, ""))
        before, words = [list(map(str, job)) for job in noted["jobs"]], list(map(in_short, noted["typed"]))
    except (UserError, KeyError, TypeError, ValueError) as error:
        raise UserError(f"resume=sweep: output={folder} holds no sweep; give the folder of one") from error
    if lenient and all(job[-1].startswith(SUBFOLDER) for job in jobs):
        places = {job[-1]: job for job in before if job}
        jobs = [job for job in jobs if job[-1] in places]
        before = [places[job[-1]] for job in jobs]
    number = next((k for k in range(max(len(jobs), len(before))) if list(jobs[k : k + 1]) != before[k : k + 1]), None)
    if number is not None:
        was, now = (in_short(" ".join(some[number])) if number < len(some) else "not there" for some in (before, jobs))
        if lenient:
            cure = "choose another one with output=..., or replace them with overwrite=true"
            raise UserError(f"{folder} has paintings with other settings: '{was}', which would be '{now}'; {cure}")
        command = shlex.join(["brushexp", "-m", *words, f"output={folder}", "resume=sweep"])
        raise UserError(
            f"resume=sweep goes on with the same settings, but job {number} was '{was}' and would be '{now}'; "
            f"type: {command}, or choose another folder"
        )


def launch_left(
    launch: Callable[..., Sequence[JobReturn]], config: DictConfig, batch: Sequence[Words], first: int, goes_on: bool
) -> Sequence[JobReturn]:
    """Launch the jobs of a batch, of which the ``first`` has this number; if it ``goes_on``, those that are left.

    Failed ones are one UserError, after all of them have ended, and each has said why.
    """
    folder = Path(config.hydra.sweep.dir)
    left = {number: list(job) for number, job in enumerate(batch, first)}
    if goes_on:
        left = {number: in_place(job, number) for number, job in left.items()}  # which no longer follow one another
        left = {number: job for number, job in left.items() if not is_done(folder / place_of(job[-1]))}
        log.info("%d of %d jobs have finished already", len(batch) - len(left), len(batch))
    try:
        results = launch(list(left.values()), initial_job_idx=min(left)) if left else []
    except Exception as error:
        if not type(error).__module__.startswith(ENGINES):
            raise
        raise UserError(f"a job has ended without a result ({first_line(error)}); go on with resume=sweep") from error
    finally:
        renew(folder)
    failed = [str(k) for k, one in zip(left, results, strict=True) if one.status is not JobStatus.COMPLETED]
    if failed:
        which, table = ", ".join(failed), folder / "table.md"
        raise UserError(f"{len(failed)} of {len(batch)} jobs failed: {which}; {table} says why")
    return results


def execute_job(
    number: int, words: list[str], context: HydraContext, config: DictConfig, task_function: TaskFunction
) -> JobReturn:
    """Run a job of a sweep in this process, for launchers."""
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


def in_place(job: Words, number: int) -> list[str]:
    """The words of a job with the one that names its folder at the end: its number if it has none."""
    named = [word for word in job if word.startswith(SUBFOLDER)] or [f"{SUBFOLDER}{number}"]
    return [*(word for word in job if not word.startswith(SUBFOLDER)), named[-1]]


def place_of(word: str) -> str:
    """The folder of a job, by the word that names it."""
    return str(OverridesParser.create().parse_override(word).value())


def is_done(folder: Path) -> bool:
    """Whether the job of this folder needs not be launched; UserError if it is at work."""
    if (folder / ".hydra").is_dir():
        check_free(folder)
    if not has_finished(folder):
        return False
    (folder / CHECKPOINT).unlink(missing_ok=True)  # the job may have been killed before it did so
    return True
