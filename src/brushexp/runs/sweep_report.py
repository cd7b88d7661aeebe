"""Hydra callback that renews page, tables, sheet and plots of a sweep after each of its jobs.

Loaded with the program: what it needs to write a report is imported when it does.
"""

import logging
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

from hydra.core.utils import JobReturn
from hydra.experimental.callback import Callback
from hydra.types import RunMode
from omegaconf import DictConfig

from brushexp.errors import UserError
from brushexp.results.runs import gather
from brushexp.results.tables import is_album, write_run_tables
from brushexp.system.files import write_json
from brushexp.system.reading import json_of, read_text
from brushexp.system.run_files import METRICS_FILE

FIRST_REPORT = 30  # seconds from the start of the program, for what a report needs takes two to load
SHARE = 0.1  # of a sweep's time that its report may take, which grows with the number of runs

log = logging.getLogger(__name__)
_next_report = time.monotonic() + FIRST_REPORT


class SweepReport(Callback):
    """Log the failure of a run, and renew ``report.html``, tables, ``sheet.png`` and plots of a sweep.

    It does so after jobs and not once at the end, because Hydra 1.3 ends a sweep with a failed job without a word to
    its callbacks.
    """

    def on_job_end(self, config: DictConfig, job_return: JobReturn, **_: Any) -> None:
        run_folder = Path(config.hydra.runtime.output_dir)
        sweep = config.hydra.mode is RunMode.MULTIRUN
        failed = isinstance(job_return._return_value, Exception)  # Hydra 1.4 comes here after Ctrl-C, too
        if failed:
            log_failure(run_folder, job_return._return_value, everywhere=sweep)
        if sweep and (failed or time.monotonic() >= _next_report):
            try:  # Hydra would turn an exception into a warning
                renew(run_folder.parent)
            except Exception as error:
                log.error("no report of this sweep: %s", error, exc_info=not isinstance(error, UserError))


def note_failure(folder: Path, error: BaseException) -> None:
    """Note in the ``metrics.json`` of a job what ended it, beside the numbers that it has written itself."""
    path, numbers = folder / METRICS_FILE, {}
    with suppress(UserError):
        numbers = json_of(read_text(path, ""))
    status = "interrupted" if isinstance(error, KeyboardInterrupt) else "failed"
    with suppress(UserError):  # a full disk may be what has ended it
        write_json(path, numbers | {"status": status, "error": first_line(error)})


def renew(folder: Path) -> None:
    """Write the report of a sweep from the results of all its runs, if there is one; one process at a time.

    After a job it is done if it then takes a tenth of the time at most, and in the end by the sweeper.
    """
    from filelock import FileLock  # noqa: PLC0415

    global _next_report  # noqa: PLW0603
    if not any(folder.glob(f"*/{METRICS_FILE}")):
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
