"""How far a piece of work is: a bar on a terminal, a few lines in the log elsewhere."""

import logging
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from datetime import timedelta
from typing import TypeVar

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TimeElapsedColumn, TimeRemainingColumn

LOG_LINES = 5  # of a whole work, where there is no terminal for a bar

log = logging.getLogger(__name__)
Item = TypeVar("Item")


@contextmanager
def showing(what: str, done: float = 0.0) -> Iterator[Callable[[float, str], None]]:
    """A function that takes which share of the work is done and a word on its state, and shows both and the time left.

    Before it is called the share is ``done``; ``what`` is the work, "simulating strokes".
    """
    console = Console(stderr=True)
    columns = ("{task.description}", BarColumn(), TaskProgressColumn(), "{task.fields[state]}")
    times = (TimeElapsedColumn(), "left", TimeRemainingColumn())
    start, logged = time.monotonic(), int(done * LOG_LINES)

    def show(share: float, state: str) -> None:
        nonlocal logged
        bar.update(task, completed=share, state=state)
        if bar.disable and int(share * LOG_LINES) > logged:
            logged = int(share * LOG_LINES)
            left = timedelta(seconds=round((time.monotonic() - start) * (1 - share) / max(share - done, 1e-9)))
            log.info("%s: %d %%, %s, %s left", what, 100 * share, state, left)

    with Progress(*columns, *times, console=console, disable=not console.is_terminal, transient=True) as bar:
        task = bar.add_task(what, total=1.0, state="")
        bar.update(task, completed=done)
        yield show


@contextmanager
def counting(what: str, total: int, done: int = 0) -> Iterator[Callable[[int], None]]:
    """A function that takes how many of ``total`` items are done, and shows it with items/s, see `showing`."""
    start, total = time.monotonic(), max(total, 1)

    def count(now: int) -> None:
        speed = (now - done) / max(time.monotonic() - start, 1e-9)
        show(now / total, f"{now} of {total}, {speed:.0f}/s")

    with showing(what, done / total) as show:
        yield count


def with_progress(
    items: Iterable[Item], total: int, what: str, size: Callable[[Item], int] = lambda item: 1
) -> Iterator[Item]:
    """Pass items on and show how many have been taken; ``total`` is their sizes together."""
    done = 0
    with counting(what, total) as show:
        for item in items:
            yield item
            done += size(item)
            show(done)
