"""Show that the program is at work while nothing else does: a line that moves, or on a pipe one now and then.

A program of the command line starts it, and everything that is written or shown puts it off. In a process that is
forked, and in Python, it does not run.
"""

import os
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TextIO

QUIET_SECONDS = 0.6  # on a terminal, after which the line appears
LINE_SECONDS = 10.0  # without a terminal: a line at least so often
TICK_SECONDS = 0.2
MARKS = "|/-\\"  # they show that something moves, on any terminal
STDERR = 2  # number of its file
CLEAR = "\r\x1b[K"


class Heartbeat:
    """A thread that writes what the program is doing, while nothing else is written."""

    def __init__(self) -> None:
        self._forget()

    def _forget(self) -> None:
        """Become one that does not run: after a fork, its thread is gone."""
        self._lock = threading.RLock()
        self._ended: threading.Event | None = None  # None while it does not run
        self._what, self._is_shown, self._bars = "", False, 0
        self._start = self._written = time.monotonic()
        self._stream: TextIO = sys.stderr

    def start(self, what: str) -> None:
        """Begin to show ``what`` the program does: "preparing"."""
        if self._ended is None:
            self._stream = _own_stderr()
            self._ended, self._start = threading.Event(), time.monotonic()
            threading.Thread(target=self._run, args=(self._ended,), daemon=True, name="heartbeat").start()
        self.say(what)

    def say(self, what: str) -> None:
        """Say what the program does now, if it runs."""
        self._what = what

    def end(self) -> None:
        """Stop, and leave no line behind."""
        self._stop()
        self.make_way()

    def _stop(self) -> None:
        if self._ended is not None:
            self._ended.set()
            self._ended = None

    def make_way(self) -> None:
        """Take the line away, because something is about to be written."""
        with self._lock:
            if self._is_shown:
                self._write(CLEAR)
            self._is_shown, self._written = False, time.monotonic()

    @contextmanager
    def behind_a_bar(self) -> Iterator[None]:
        """Show nothing while a bar moves on the terminal."""
        self.make_way()
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
        except (OSError, ValueError):  # closed
            self._stop()


def _own_stderr() -> TextIO:
    """Return a stream of its own to where stderr goes now: decoders close that for a while."""
    try:
        if sys.stderr.fileno() == STDERR:
            return os.fdopen(os.dup(STDERR), "w", encoding="utf-8", errors="replace")
    except (AttributeError, OSError, ValueError):  # no file
        pass
    return sys.stderr


def _is_terminal() -> bool:
    """Whether stderr is a terminal on which a line can be taken back."""
    return sys.stderr.isatty() and os.environ.get("TERM", "dumb") not in ("dumb", "unknown")


heartbeat = Heartbeat()
if hasattr(os, "register_at_fork"):  # Windows does not fork
    os.register_at_fork(after_in_child=heartbeat._forget)
