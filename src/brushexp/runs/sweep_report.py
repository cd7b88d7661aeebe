"""Write the page, tables, contact sheet and plots of a sweep; slow imports wait until a report is written."""

import logging
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

from hydra.core.utils import JobReturn
from hydra.experimental.callback import Callback
from hydra.types import RunMode
from omegaconf import DictConfig

from brushexp.errors import UserError, first_line
from brushexp.results.runs import gather
from brushexp.results.tables import write_run_tables
from brushexp.system.files import write_json
from brushexp.system.reading import json_of, read_text
from brushexp.system.run_files import METRICS_FILE
from brushexp.system.status import Status

REPORT_SHARE = 0.1  # largest share of a sweep's time spent on its reports

log = logging.getLogger(__name__)
_next_report = time.monotonic() + 30  # seconds; the imports of a report take two


class SweepReport(Callback):
    """A callback that logs failed jobs, and renews the report of a sweep after each failure and from time to time.

    It does not wait for the end of the sweep, because Hydra 1.3 calls no callbacks at the end if a job has failed.
    """

    def on_job_end(self, config: DictConfig, job_return: JobReturn, **_: Any) -> None:
        run_folder = Path(config.hydra.runtime.output_dir)
        sweep = config.hydra.mode is RunMode.MULTIRUN
        failed = isinstance(job_return._return_value, Exception)  # Hydra 1.4 also reports Ctrl-C here
        if failed:
            _log_failure(run_folder, job_return._return_value, everywhere=sweep)
        if sweep and (failed or time.monotonic() >= _next_report):
            try:  # Hydra would turn an exception into a warning
                renew_sweep_report(run_folder.parent)
            except Exception as error:
                log.error("the report of this sweep failed: %s", error, exc_info=not isinstance(error, UserError))


def note_failure(folder: Path, error: BaseException) -> None:
    """Record the error that ended a job in its ``metrics.json``."""
    path, numbers = folder / METRICS_FILE, {}
    with suppress(UserError):
        numbers = json_of(read_text(path, ""))
    status = Status.INTERRUPTED if isinstance(error, KeyboardInterrupt) else Status.FAILED
    words = first_line(error) if status == Status.FAILED else "KeyboardInterrupt"  # this job was interrupted
    with suppress(UserError):  # the disk may be full
        write_json(path, numbers | {"status": status, "error": words})


def renew_sweep_report(folder: Path) -> None:
    """Write the report of a sweep if any of its runs have results; only one process writes at a time."""
    from filelock import FileLock  # noqa: PLC0415

    global _next_report  # noqa: PLW0603
    if not any(folder.glob(f"*/{METRICS_FILE}")):
        return
    start = time.monotonic()
    with FileLock(folder / ".hydra" / "report.lock"):
        _write_report(folder)
    _next_report = time.monotonic() + (time.monotonic() - start) / REPORT_SHARE


def _write_report(folder: Path) -> None:
    from brushexp.pages.sweep_page import write_sweep_page  # noqa: PLC0415
    from brushexp.results.comparisons import comparisons  # noqa: PLC0415

    frame = gather([folder], folder)
    write_run_tables(folder, frame)
    write_sweep_page(folder, frame)
    for comparison in comparisons():
        comparison.write(folder, frame)


def _log_failure(folder: Path, error: BaseException, *, everywhere: bool) -> None:
    """Log an error to the run's log file or, if ``everywhere``, to all handlers; Hydra prints only the first error."""
    trace = None if isinstance(error, UserError) else (type(error), error, error.__traceback__)
    message = f"run {folder.name} failed: {first_line(error)}"
    record = log.makeRecord(log.name, logging.ERROR, __file__, 0, message, (), trace)
    for handler in logging.getLogger().handlers:
        if everywhere or isinstance(handler, logging.FileHandler):
            handler.handle(record)
