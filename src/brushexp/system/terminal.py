"""A log handler that shows important messages on the terminal; run.log has every message, with dates and numbers."""

import logging
import os
import sys
from pathlib import Path
from typing import Any

from brushexp.errors import on_a_line
from brushexp.system.heartbeat import heartbeat

IN_LOG: dict[str, Any] = {"shown": ""}  # ``extra`` for messages that the terminal does not show
LAYOUT = "\n\t"  # whitespace in tables and tracebacks
_said: set[str] = set()  # warnings shown so far, because jobs of a sweep often repeat them
HEADS = {logging.WARNING: "note: ", logging.ERROR: "brushexp: ", logging.CRITICAL: "brushexp: "}


class Terminal(logging.Handler):
    """Writes messages to the terminal without dates or module names.

    Warnings and errors go to stderr, and each warning is shown only once.
    """

    def emit(self, record: logging.LogRecord) -> None:
        try:
            shown = getattr(record, "shown", None)
            words = self.format(record).strip() if shown is None else shown
            if not words or words in _said:
                return
            if record.levelno == logging.WARNING:
                _said.add(words)
            heartbeat.clear_line()
            stream = sys.stdout if record.levelno < logging.WARNING else sys.stderr
            stream.write(f"{HEADS.get(record.levelno, '')}{on_a_line(words, besides=LAYOUT)}\n")
            stream.flush()
        except Exception:  # a closed pipe or a full disk
            self.handleError(record)


def as_shown(path: Path) -> str:
    """Format a path for messages: relative to the working folder if it is inside that folder."""
    near = os.path.relpath(path)
    return str(path) if near.startswith("..") else near
