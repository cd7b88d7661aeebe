"""Show the progress of work as a bar on a terminal, or as a few log lines elsewhere."""

import logging
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, nullcontext
from datetime import timedelta
from typing import TypeVar

from brushexp.system.heartbeat import heartbeat

LOG_LINES = 5  # number of lines for the whole work without a terminal that can show a bar
NARROW = 72  # terminal columns below which there is no room for the remaining time

log = logging.getLogger(__name__)
Item = TypeVar("Item")


@contextmanager
def showing(what: str, done: float = 0.0) -> Iterator[Callable[[float, str], None]]:
    """Yield a function that takes the completed fraction and a short state, and shows both with the remaining time.

    ``what`` names the work, such as "simulating strokes", and ``done`` is the initial fraction. Only run.log gets the
    text after a comma in the state, such as "24.80 dB" in "step 6 of 30, 24.80 dB".
    """
    from rich.console import Console  # noqa: PLC0415 (fifty modules, which the help does without)
    from rich.progress import (  # noqa: PLC0415
        BarColumn,
        Progress,
        TaskProgressColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    console = Console(stderr=True)
    has_bar = console.file.isatty() and not console.is_dumb_terminal
    middle = (BarColumn(), TaskProgressColumn(), "{task.fields[state]}", TimeElapsedColumn())
    columns = middle if console.width >= NARROW else (TaskProgressColumn(),)
    start, logged = time.monotonic(), int(done * LOG_LINES)

    def show(share: float, state: str) -> None:
        nonlocal logged
        plain = state.partition(", ")[0]
        bar.update(task, completed=share, state=plain)
        if bar.disable:
            heartbeat.say(f"{what}: {int(100 * share)} %, {plain}")
        if bar.disable and int(share * LOG_LINES) > logged:
            logged = int(share * LOG_LINES)
            remaining = timedelta(seconds=round((time.monotonic() - start) * (1 - share) / max(share - done, 1e-9)))
            words = [f"{what}: {int(100 * share)} %, {each}, {remaining} left" for each in (state, plain)]
            log.info("%s", words[0], extra={"shown": words[1]})

    shown = ("{task.description}", *columns, "left", TimeRemainingColumn())
    behind = heartbeat.paused() if has_bar else nullcontext()
    with behind, Progress(*shown, console=console, disable=not has_bar, transient=True) as bar:
        task = bar.add_task(what, total=1.0, state="")
        bar.update(task, completed=done)
        yield show


@contextmanager
def counting(what: str, total: int, done: int = 0) -> Iterator[Callable[[int], None]]:
    """Yield a function that takes the number of items done, and shows it with ``total`` and the rate; see `showing`."""
    start, total = time.monotonic(), max(total, 1)

    def count(now: int) -> None:
        speed = (now - done) / max(time.monotonic() - start, 1e-9)
        pace = f"{speed:.0f}/s" if speed >= 1 else f"{60 * speed:.1f}/min"
        show(now / total, f"{now} of {total} at {pace}")

    with showing(what, done / total) as show:
        yield count


def with_progress(
    items: Iterable[Item], total: int, what: str, size: Callable[[Item], int] = lambda item: 1
) -> Iterator[Item]:
    """Yield the items while showing progress; ``total`` is the sum of their sizes."""
    done = 0
    with counting(what, total) as show:
        for item in items:
            yield item
            done += size(item)
            show(done)
