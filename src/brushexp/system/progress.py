"""How far a piece of work is: a bar on a terminal, a few lines in the log elsewhere."""

import logging
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import TypeVar

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

LOG_LINES = 10  # of a whole work, where there is no terminal for a bar

log = logging.getLogger(__name__)
Item = TypeVar("Item")


@contextmanager
def counting(what: str, total: int, done: int = 0) -> Iterator[Callable[[int], None]]:
    """A function that takes how many of ``total`` items are done and shows it, with items/s and the time left.

    Args:
        what: is being done, "simulating strokes".
        total: items.
        done: items that are there already.
    """
    console = Console(stderr=True)
    columns = (TextColumn(what), BarColumn(), MofNCompleteColumn(), TextColumn("{task.fields[speed]:.0f}/s"))
    times = (TimeElapsedColumn(), TextColumn("left"), TimeRemainingColumn())
    start, logged = time.monotonic(), done * LOG_LINES // max(total, 1)

    def show(now: int) -> None:
        nonlocal logged
        speed = (now - done) / max(time.monotonic() - start, 1e-9)
        bar.update(task, completed=now, speed=speed)
        if bar.disable and now * LOG_LINES // total > logged:
            logged = now * LOG_LINES // total
            log.info("%s: %d of %d, %.0f/s, %.0f s left", what, now, total, speed, (total - now) / max(speed, 1e-9))

    with Progress(*columns, *times, console=console, disable=not console.is_terminal, transient=True) as bar:
        task = bar.add_task(what, total=total, completed=done, speed=0.0)
        yield show


def with_progress(
    items: Iterable[Item], total: int, what: str, size: Callable[[Item], int] = lambda item: 1
) -> Iterator[Item]:
    """Pass items on and show how many have been taken.

    Args:
        items: what takes long.
        total: their sizes together.
        what: is being done.
        size: of one of them.
    """
    done = 0
    with counting(what, total) as show:
        for item in items:
            yield item
            done += size(item)
            show(done)
