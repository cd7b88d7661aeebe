"""Say on the terminal what a person wants to know, in plain words; run.log has everything, with dates and figures."""

import logging
import os
import sys
from pathlib import Path
from typing import Any

from brushexp.errors import on_a_line
from brushexp.system.heartbeat import heartbeat

IN_LOG: dict[str, Any] = {"shown": ""}  # ``extra`` of what the terminal does not show
LAYOUT = "\n\t"  # of tables and tracebacks
_said: set[str] = set()  # notes so far: jobs of a sweep often have the same
HEADS = {logging.WARNING: "note: ", logging.ERROR: "brushexp: ", logging.CRITICAL: "brushexp: "}


class Terminal(logging.Handler):
    """Write messages to the terminal without dates and modules, warnings (each once) and errors to stderr."""

    def emit(self, record: logging.LogRecord) -> None:
        try:
            shown = getattr(record, "shown", None)
            words = self.format(record).strip() if shown is None else shown
            if not words or words in _said:
                return
            if record.levelno == logging.WARNING:
                _said.add(words)
            heartbeat.make_way()
            stream = sys.stdout if record.levelno < logging.WARNING else sys.stderr
            stream.write(f"{HEADS.get(record.levelno, '')}{on_a_line(words, besides=LAYOUT)}\n")
            stream.flush()
        except Exception:  # a closed pipe, a full disk
            self.handleError(record)


def as_shown(path: Path) -> str:
    """Write a path as it is typed from the working folder, if it lies in there."""
    near = os.path.relpath(path)
    return str(path) if near.startswith("..") else near
