"""Hydra callback: the result of every run of a sweep; and page, tables, sheet and plots renewed after each.

Loaded with the program: what it needs to write a report is imported when it does.
"""

import logging
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from hydra.core.utils import JobReturn, JobStatus
from hydra.experimental.callback import Callback
from hydra.types import RunMode
from omegaconf import DictConfig, OmegaConf

from brushexp.errors import UserError
from brushexp.results.runs import gather, parse_overrides
from brushexp.results.tables import is_album, write_run_tables
from brushexp.system.files import write_json
from brushexp.system.reading import json_of, read_text

FIRST_REPORT = 30  # seconds from the start of the program, for what a report needs takes two to load
SHARE = 0.1  # of a sweep's time that its report may take, which grows with the number of runs

log = logging.getLogger(__name__)
_next_report = time.monotonic() + FIRST_REPORT


class SweepReport(Callback):
    """Write ``result.json`` into every run of a sweep and renew its ``report.html``, tables, ``sheet.png`` and plots.

    Does it after jobs and not once at the end, because Hydra 1.3 ends a sweep with a failed job without a word to its
    callbacks. A single run has its metrics.json and needs none of this.
    """

    def on_job_end(self, config: DictConfig, job_return: JobReturn, **_: Any) -> None:
        run_folder = Path(config.hydra.runtime.output_dir)
        sweep = config.hydra.mode is RunMode.MULTIRUN
        if job_return.status is JobStatus.FAILED:
            log_failure(run_folder, job_return._return_value, everywhere=sweep)
        if sweep:
            note_result(run_folder, config, config.hydra.overrides.task, job_return._return_value)


def note_result(folder: Path, cfg: DictConfig, overrides: Sequence[str], result: Any) -> None:
    """Write the ``result.json`` of a job, of what its task returned or raised, and renew the report of its sweep."""
    try:  # Hydra would turn an exception into a warning
        if isinstance(result, float):  # the one that was its objective
            result = json_of(read_text(folder / "metrics.json", ""))
        write_json(folder / "result.json", result_of(folder.name, cfg, overrides, result))
        if time.monotonic() >= _next_report or isinstance(result, BaseException):
            renew(folder.parent)
    except Exception as error:
        log.error("no report of this run: %s", error, exc_info=not isinstance(error, UserError))


def renew(folder: Path) -> None:
    """Write the report of a sweep from the results of all its runs, if there is one; one process at a time.

    After a job it is done if it then takes a tenth of the time at most, and in the end by the sweeper.
    """
    from filelock import FileLock  # noqa: PLC0415

    global _next_report  # noqa: PLW0603
    if not any(folder.glob("*/result.json")):
        return
    start = time.monotonic()
    with FileLock(folder / ".hydra" / "report.lock"):
        write_report(folder)
    _next_report = time.monotonic() + (time.monotonic() - start) / SHARE


def write_report(folder: Path) -> None:
    """Write page, tables, sheet and plots of a sweep."""
    from brushexp.results.contact_sheet import write_contact_sheet  # noqa: PLC0415
    from brushexp.results.effect import write_effect  # noqa: PLC0415
    from brushexp.results.paired import write_differences  # noqa: PLC0415

    frame = gather([folder], folder)
    if is_album(frame):
        write_tables_and_page(folder, frame)
    else:
        write_differences(folder, frame)  # which the page shows
        write_comparison(folder, frame)
        write_effect(folder, frame)
    write_contact_sheet(folder, frame)


def write_tables_and_page(folder: Path, frame: Any) -> None:
    """Write tables and the page of some runs."""
    from brushexp.pages.sweep_page import write_sweep_page  # noqa: PLC0415

    write_run_tables(folder, frame)
    write_sweep_page(folder, frame)


def write_comparison(folder: Path, frame: Any) -> Path | None:
    """Write tables, front, curves, quality at equal time and the page of some runs; return the table of the front."""
    from brushexp.results.anytime_curves import write_anytime, write_curves  # noqa: PLC0415
    from brushexp.results.pareto import write_front  # noqa: PLC0415

    front = write_front(folder, frame)
    write_anytime(folder, frame)
    write_curves(folder, frame)
    write_tables_and_page(folder, frame)
    return front


def result_of(run: str, cfg: DictConfig, overrides: Sequence[str], result: Any) -> dict[str, Any]:
    """What ``result.json`` of a run holds: its settings, how it ended, and the numbers that the task returned."""
    found: dict[str, Any] = {"run": run, "status": "completed", "overrides": parse_overrides(overrides)}
    losses = OmegaConf.select(cfg, "loss")
    if losses is not None:
        found["loss"] = "+".join(losses)  # the choices that Hydra records leave out groups chosen by a list
    if isinstance(result, BaseException):
        status = "interrupted" if isinstance(result, KeyboardInterrupt) else "failed"
        return found | {"status": status, "error": first_line(result)}
    return found | (result or {})


def first_line(error: BaseException) -> str:
    """What went wrong, on one line; the kind of error too unless it is a message to the user."""
    text = str(error).strip().partition("\n")[0]
    kind = type(error).__name__
    return text if isinstance(error, UserError) else f"{kind}: {text}" if text else kind


def log_failure(folder: Path, error: BaseException, *, everywhere: bool) -> None:
    """Put an error into the run's log, where Hydra does not, with a traceback unless it is a message to the user.

    ``everywhere`` is on the terminal too: Hydra shows that of a single run, but only the first of a sweep.
    """
    trace = None if isinstance(error, UserError) else (type(error), error, error.__traceback__)
    message = f"run {folder.name} failed: {first_line(error)}"
    record = log.makeRecord(log.name, logging.ERROR, __file__, 0, message, (), trace)
    for handler in logging.getLogger().handlers:
        if everywhere or isinstance(handler, logging.FileHandler):
            handler.handle(record)
