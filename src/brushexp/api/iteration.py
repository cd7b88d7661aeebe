"""``brushexp.iterate``: yield intermediate states of a painting during optimisation."""

from __future__ import annotations

import atexit
import math
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from dataclasses import dataclass, field
from queue import SimpleQueue
from typing import TYPE_CHECKING, Any

import lightning as L
import numpy as np

from brushexp.api.painting import Painting, painting_of, plan_of
from brushexp.bounds import at_least
from brushexp.pictures.similarity import psnr_of
from brushexp.strokes.catalogue import Strokes
from brushexp.system.files import to_bytes
from brushexp.system.status import Status

if TYPE_CHECKING:
    from os import PathLike

    from brushexp.api.painting import Picture
    from brushexp.api.settings import Settings


def _stay() -> None:
    """Do nothing, in place of `State.stop`, when the painting is finished or is optimised in another process."""


@dataclass(frozen=True)
class State:
    """Snapshot of a painting after an optimisation step."""

    step: int  # gradient steps taken
    steps: int  # planned steps; ``seconds`` revises the plan on the way
    seconds: float  # seconds of optimisation so far
    image: np.ndarray  # (H, W, 3) uint8, as the last step drew it; in the last state, the painting under its lamp
    strokes: Strokes  # the N current strokes
    psnr: float  # PSNR of the picture that the last step drew, dB
    painting: Painting | None = field(default=None, repr=False)  # in the last state only
    stop: Callable[[], None] = field(default=_stay, repr=False)  # call it to make the next state the last

    def __getstate__(self) -> dict[str, Any]:
        return {**vars(self), "stop": _stay}  # another process cannot end the painting


class Handover(L.Callback):
    """Channel that passes states to another thread.

    The painter stays at most one state ahead, and its clock stops while it waits.
    """

    def __init__(self, every: int, every_seconds: float) -> None:
        self.every, self.every_seconds = every, every_seconds
        self.states: SimpleQueue[State | None] = SimpleQueue()  # None when the painting is done
        self.room = threading.Semaphore(1)
        self.stopped, self.closed = threading.Event(), threading.Event()
        self.last, self.step = -float("inf"), -1  # time of the last state, and the previous step

    def on_train_start(self, trainer: L.Trainer, painter: Any) -> None:
        self.on_train_batch_end(trainer, painter)

    def on_train_batch_end(self, trainer: L.Trainer, painter: Any, *_: object) -> None:
        before, self.step = self.step, painter.schedule.step
        if self.stopped.is_set() or self.closed.is_set():
            painter.stop = painter.stop or (Status.INTERRUPTED if self.closed.is_set() else Status.STOPPED)
            trainer.should_stop = True
        elif not painter.is_done and self._is_due(before):
            self.last = time.monotonic()
            painter.schedule.pause()
            self.room.acquire()
            self.states.put(self.state_of(painter))
            painter.schedule.start()

    def _is_due(self, before: int) -> bool:
        """Check whether a state is due.

        A multiple of ``every`` must have been reached since ``before``, and ``every_seconds`` must have passed.
        """
        is_next = self.step // self.every > before // self.every
        return is_next and time.monotonic() - self.last >= self.every_seconds

    def state_of(self, painter: Any) -> State:
        schedule, image, error = painter.schedule, painter.latest(), painter.picture.error
        if math.isinf(error):  # no picture has been painted yet
            error = float((image - painter.picture.target).square().mean())
        numbers = schedule.step, schedule.steps, schedule.seconds
        return State(*numbers, to_bytes(image), painter.strokes(), psnr_of(error), stop=self.stopped.set)


def iterate(
    image: Picture,
    *,
    every: int = 10,
    every_seconds: float = 0,
    look: str | None = None,
    strokes: int | None = None,
    seconds: float | None = None,
    output: str | PathLike[str] | None = None,
    **overrides: Any,
) -> Iterator[State]:
    """Paint as `paint` does, with identical results, and yield the initial state and then one every ``every`` steps.

    A background thread paints, at most one state ahead of the caller; the time it spends waiting does not count towards
    ``seconds``. The last state holds the finished ``painting``. ``state.stop()`` makes the next state the last; closing
    the generator stops the painting without a final state. Until the painting has ended, it uses PyTorch's global
    random generators.

    ``every`` is a number of steps, and ``every_seconds`` is the shortest time between two states. With ``every=1``, a
    state is yielded after each step, and painting waits for the caller. The other arguments are those of `paint`.

    Raises:
        UserError: if the settings are wrong (raised by this call), or if painting fails (raised by the generator).

    >>> for state in iterate("astronaut", every=2, look="plain", resolution=32, strokes=20, steps=4):
    ...     print(state.step, state.steps, state.image.shape)
    0 4 (32, 32, 3)
    2 4 (32, 32, 3)
    4 4 (32, 32, 3)
    >>> len(state.painting.strokes)
    20
    """
    at_least(1).check("every", every)
    at_least(0).check("every_seconds", every_seconds)
    settings = plan_of(image, output, {"look": look, "strokes": strokes, "seconds": seconds}, overrides)
    return states_of(settings, Handover(every, every_seconds))


def states_of(settings: Settings, handover: Handover) -> Iterator[State]:
    """Paint in a background thread and yield the states it hands over, then the final state."""
    painting: Future[Painting] = Future()
    thread = threading.Thread(target=_paint, args=(settings, handover, painting), name="brushexp", daemon=True)

    def close() -> None:
        handover.closed.set()
        handover.room.release()  # the painter may be waiting for it
        if threading.current_thread() is not thread:  # the thread itself may collect the generator as garbage
            thread.join()

    atexit.register(close)
    thread.start()
    try:
        while (state := handover.states.get()) is not None:
            handover.room.release()
            if not handover.stopped.is_set():
                yield state
        finished = painting.result()
        metrics = finished.metrics
        numbers = metrics["steps"], metrics["steps"], metrics["seconds"]
        picture = finished.finished.pictures["painting"]
        strokes = finished.finished.job.at_size(picture.shape[:2]).strokes
        yield State(*numbers, picture, strokes, metrics["psnr"], finished)
    finally:
        if not handover.closed.is_set():  # otherwise the program may end while the thread still needs its modules
            close()
            atexit.unregister(close)


def _paint(settings: Settings, handover: Handover, painting: Future[Painting]) -> None:
    try:
        painting.set_result(painting_of(settings, [handover]))
    except BaseException as error:
        painting.set_exception(error)
    finally:
        handover.states.put(None)
