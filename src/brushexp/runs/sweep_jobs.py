"""Check, record and launch the jobs of a sweep, for Hydra's sweepers and launchers."""

import logging
import shlex
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.utils import JobReturn, JobStatus
from omegaconf import DictConfig, OmegaConf

from brushexp.config.check import check
from brushexp.config.words import ALL_PIXELS, verbatim
from brushexp.errors import UserError, first_line
from brushexp.registry import drop_built
from brushexp.results.runs import JOBS, has_finished
from brushexp.runs.closing import log_page
from brushexp.runs.run_folder import check_free, check_place, take_folder, take_name
from brushexp.runs.sweep_report import renew_sweep_report
from brushexp.system.files import write_json
from brushexp.system.heartbeat import heartbeat
from brushexp.system.reading import json_of, read_text, shorten_value
from brushexp.system.run_files import CHECKPOINT

ENGINES = ("joblib.", "submitit.", "distributed.")  # modules whose errors mean that jobs were killed
PICTURE = "image="
INTERNAL = ("hydra.mode=MULTIRUN", "hydra.sweeper.resume=true", "hydra.searchpath=")  # words that users never type
SUBFOLDER = "hydra.sweep.subdir="  # word that names the folder of a job
Words = Sequence[str]

log = logging.getLogger(__name__)


def check_jobs(loader: Any, config: DictConfig, jobs: Sequence[Words], lenient: bool = False) -> list[str]:
    """Check the jobs of a sweep, and return their folders, relative to the sweep's folder.

    Raises a UserError if a job is invalid or shares its folder with an earlier job. If ``lenient``, each such job
    causes only a warning, unless every job of the sweep is refused.
    """
    refused, composed, places = [], dict[tuple[str, ...], DictConfig](), list[str]()
    alike = () if "override_dirname" in OmegaConf.to_yaml(config.hydra.sweep) else (PICTURE, SUBFOLDER)
    for number, job in enumerate(jobs):
        try:
            others = tuple(word for word in job if not word.startswith(alike))
            if others not in composed:  # composing is slow, and the picture changes nothing else
                composed[others] = loader.load_sweep_config(config, list(job))
            cfg = composed[others].copy()
            cfg.hydra.job.num = number
            for word in job:
                if word.startswith((PICTURE, SUBFOLDER)):
                    OmegaConf.update(cfg, word.partition("=")[0], override_value(word))
            if (place := str(cfg.hydra.sweep.subdir)) in places:
                cure = "drop it, or type 'hydra.sweep.subdir=job${hydra.job.num}'"
                raise UserError(f"{SUBFOLDER}{place} is also the folder of an earlier job; {cure}")
            places.append(place)
            check(cfg, job)
        except UserError as error:
            is_plain = lenient and str(error).startswith(PICTURE)  # the message already names the picture
            refused.append(f"{error}" if is_plain else f"job {number} of the sweep ({' '.join(job)}): {error}")
            if not lenient or len(refused) == len(jobs):
                raise UserError(refused[0]) from error
    drop_built()  # each job builds its own plugins
    for reason in refused:
        log.warning("%s; it is skipped", reason)
    return places


def begin_sweep(config: DictConfig, jobs: Sequence[Words], goes_on: bool, lenient: bool = False) -> None:
    """Claim the folder of a sweep and record its jobs; a resumed sweep (``goes_on``) must have the same jobs as before.

    A ``lenient`` sweep may add or drop jobs, but must not put a different job into the folder of an earlier one. Any
    other change raises a UserError.
    """
    check_place(config)
    folder = take_name(config, Path(config.hydra.sweep.dir))
    words = [_without_output(job) for job in jobs]
    if goes_on:
        check_same(folder, words, lenient)
    take_folder(folder, config, goes_on)
    overrides: Any = OmegaConf.to_container(config.hydra.overrides, resolve=False)  # jobs resolve ``${...}``
    typed = _without_output([*overrides["hydra"], *overrides["task"]])
    typed = [word for word in typed if not word.startswith(INTERNAL)]
    write_json(folder / JOBS, {"typed": typed, "jobs": words})


def _without_output(words: Words) -> list[str]:
    return [word for word in words if word.partition("=")[0] not in ("output", "overwrite")]


def check_same(folder: Path, jobs: Sequence[Words], lenient: bool = False) -> None:
    """Raise a UserError unless a folder holds a sweep of these jobs.

    If ``lenient``, a job need not be in the earlier sweep, but it must not differ from the earlier job in its folder.
    """
    try:
        noted = json_of(read_text(folder / JOBS, ""))
        before, words = [list(map(str, job)) for job in noted["jobs"]], list(map(shorten_value, noted["typed"]))
    except (UserError, KeyError, TypeError, ValueError) as error:
        raise UserError(f"resume=sweep: output={folder} does not hold a sweep; give the folder of a sweep") from error
    before, jobs = ([[word for word in job if word != ALL_PIXELS] for job in some] for some in (before, jobs))
    if lenient and all(job[-1].startswith(SUBFOLDER) for job in jobs):
        places = {job[-1]: job for job in before if job}
        jobs = [job for job in jobs if job[-1] in places]
        before = [places[job[-1]] for job in jobs]
    number = next((k for k in range(max(len(jobs), len(before))) if list(jobs[k : k + 1]) != before[k : k + 1]), None)
    if number is not None:
        was, now = (
            shorten_value(" ".join(some[number])) if number < len(some) else "not there" for some in (before, jobs)
        )
        if lenient:
            cure = "choose another one with output=..., or replace them with overwrite=true"
            raise UserError(f"{folder} has paintings with other settings, '{was}' in place of '{now}'; {cure}")
        command = shlex.join(["brushexp", "-m", *words, f"output={folder}", "resume=sweep"])
        raise UserError(
            f"resume=sweep needs the same settings, but job {number} was '{was}' and would be '{now}'; "
            f"type: {command}, or choose another folder"
        )


def launch_jobs(
    launch: Callable[..., Sequence[JobReturn]], config: DictConfig, batch: Sequence[Words], first: int, goes_on: bool
) -> None:
    """Launch the jobs of a batch, numbered from ``first``; if the sweep ``goes_on``, launch only the unfinished ones.

    If jobs fail, a single UserError lists them after all jobs have ended.
    """
    folder = Path(config.hydra.sweep.dir)
    jobs = {number: list(job) for number, job in enumerate(batch, first)}
    if goes_on:  # the numbers then have gaps
        jobs = {number: job for number, job in jobs.items() if not _is_done(folder / str(override_value(job[-1])))}
        log.info("%d of %d jobs are already finished", len(batch) - len(jobs), len(batch))
    heartbeat.end()
    try:
        results = launch(list(jobs.values()), initial_job_idx=min(jobs)) if jobs else []
    except Exception as error:
        if not type(error).__module__.startswith(ENGINES):
            raise
        raise UserError(f"a job ended without a result ({first_line(error)}); continue with resume=sweep") from error
    finally:
        renew_sweep_report(folder)
    log_page(folder, "shows all of them")
    failed = [str(k) for k, one in zip(jobs, results, strict=True) if one.status is not JobStatus.COMPLETED]
    if failed:
        table = folder / "table.md"
        raise UserError(f"{len(failed)} of {len(batch)} jobs failed: {', '.join(failed)}; {table} says why")


def move_job(job: Words, place: str) -> list[str]:
    """Return a job's overrides with ``place`` as its folder."""
    return [*(word for word in job if not word.startswith(SUBFOLDER)), SUBFOLDER + verbatim(place)]


def override_value(word: str) -> Any:
    """Return the parsed value of a command-line override."""
    return OverridesParser.create().parse_override(word).value()


def _is_done(folder: Path) -> bool:
    """Check whether the job in a folder has finished; raise a UserError if it is still running."""
    if (folder / ".hydra").is_dir():
        check_free(folder)
    if not has_finished(folder):
        return False
    (folder / CHECKPOINT).unlink(missing_ok=True)  # the job may have been killed just before removing it
    return True
