"""Show that the program is working while it prints nothing else.

On a terminal, the heartbeat updates a single line; elsewhere, it writes a new line from time to time. The command line
starts it, and any other output postpones it. It does not run in forked processes or in the Python API.
"""

import os
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TextIO

QUIET_SECONDS = 0.6  # seconds of silence before the line appears on a terminal
LINE_SECONDS = 10.0  # seconds of silence before a line without a terminal
TICK_SECONDS = 0.2
MARKS = "|/-\\"  # frames of the moving mark, for any terminal
STDERR = 2  # its file descriptor
CLEAR = "\r\x1b[K"


class Heartbeat:
    """A background thread that shows what the program is doing while there is no other output."""

    def __init__(self) -> None:
        self._forget()

    def _forget(self) -> None:
        """Set the initial state, also after a fork, which the thread does not survive."""
        self._lock = threading.RLock()
        self._ended: threading.Event | None = None  # None while it is not running
        self._what, self._is_shown, self._bars = "", False, 0
        self._start = self._written = time.monotonic()
        self._stream: TextIO = sys.stderr

    def start(self, what: str) -> None:
        """Start the heartbeat and show ``what`` the program is doing, such as "preparing"."""
        if self._ended is None:
            self._stream = _own_stderr()
            self._ended, self._start = threading.Event(), time.monotonic()
            threading.Thread(target=self._run, args=(self._ended,), daemon=True, name="heartbeat").start()
        self.say(what)

    def say(self, what: str) -> None:
        """Change the displayed text; this does not start the heartbeat."""
        self._what = what

    def end(self) -> None:
        """Stop the heartbeat and clear its line."""
        self._stop()
        self.clear_line()

    def _stop(self) -> None:
        if self._ended is not None:
            self._ended.set()
            self._ended = None

    def clear_line(self) -> None:
        """Clear the line to make room for other output."""
        with self._lock:
            if self._is_shown:
                self._write(CLEAR)
            self._is_shown, self._written = False, time.monotonic()

    @contextmanager
    def paused(self) -> Iterator[None]:
        """Pause the heartbeat within the ``with`` block, while the terminal shows a progress bar."""
        self.clear_line()
        self._bars += 1
        try:
            yield
        finally:
            self._bars -= 1
            self._written = time.monotonic()

    def _run(self, ended: threading.Event) -> None:
        moves = _is_terminal()
        tick = 0
        while not ended.wait(TICK_SECONDS):
            with self._lock:
                silence = time.monotonic() - self._written
                if ended.is_set() or self._bars or silence < (QUIET_SECONDS if moves else LINE_SECONDS):
                    continue
                passed = round(time.monotonic() - self._start)
                if moves:
                    self._write(f"{CLEAR}{MARKS[tick % len(MARKS)]} {self._what}, {passed} s\r")
                    self._is_shown = True
                else:
                    self._write(f"{self._what}, {passed} s so far\n")
                    self._written = time.monotonic()
            tick += 1

    def _write(self, text: str) -> None:
        try:
            self._stream.write(text)
            self._stream.flush()
        except (OSError, ValueError):  # the stream is closed
            self._stop()


def _own_stderr() -> TextIO:
    """Return a duplicate of stderr, if possible, because decoders temporarily close the original."""
    try:
        if sys.stderr.fileno() == STDERR:
            return os.fdopen(os.dup(STDERR), "w", encoding="utf-8", errors="replace")
    except (AttributeError, OSError, ValueError):  # stderr is not a file
        pass
    return sys.stderr


def _is_terminal() -> bool:
    """Return whether stderr is a terminal that can clear a line."""
    return sys.stderr.isatty() and os.environ.get("TERM", "dumb") not in ("dumb", "unknown")


heartbeat = Heartbeat()
if hasattr(os, "register_at_fork"):  # Windows does not fork
    os.register_at_fork(after_in_child=heartbeat._forget)
