"""Callbacks of every fit here: the progress bar, checkpoints by time, Ctrl-C, the moving average of weights."""

from __future__ import annotations

import logging
import math
import time
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Protocol, cast

import lightning as L
from lightning.pytorch.callbacks import Checkpoint, WeightAveraging
from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from torch.optim.swa_utils import get_ema_multi_avg_fn

from brushexp.system.files import replacing
from brushexp.system.runtime import interruptible

log = logging.getLogger(__name__)
INTERRUPTED = "interrupted"
NOTICES = 5  # lines in the log of a run, where there is no terminal for a bar
REFRESH_SECONDS = 0.2  # between two updates of the bar: reading the loss and writing a line cost time


class Watched(Protocol):
    """What these callbacks read of a LightningModule.

    Attributes:
        title: what is being done, for the bar; a new title begins a new bar.
        progress: how much of that is done, 0 to 1.
        stop: why the fit ends before its last step; "" while it goes on.
    """

    stop: str

    @property
    def title(self) -> str: ...

    @property
    def progress(self) -> float: ...

    def state_line(self) -> str:
        """Step, loss and quality in a few words."""


class ProgressBar(L.Callback):
    """A bar with the state of the module and the time left; a few lines in the log where there is no terminal."""

    def __init__(self) -> None:
        console = Console(stderr=True)
        self.bar = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            TaskProgressColumn(),
            TextColumn("{task.fields[state]}"),
            TimeElapsedColumn(),
            TextColumn("left"),
            TimeRemainingColumn(),
            console=console,
            disable=not console.is_terminal,
            transient=True,
            refresh_per_second=1 / REFRESH_SECONDS,
        )
        self.title, self.noticed, self.shown = "", 0, -math.inf

    def on_train_start(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        self.bar.start()
        self.task = self.bar.add_task("", total=1.0, state="")
        self._begin(cast(Watched, pl_module))

    def on_train_batch_end(self, trainer: L.Trainer, pl_module: L.LightningModule, *_: object) -> None:
        now, module = time.monotonic(), cast(Watched, pl_module)
        if now - self.shown < REFRESH_SECONDS and module.progress < 1:
            return
        self.shown = now
        if module.title != self.title:
            self._begin(module)
        self.bar.update(self.task, completed=module.progress, state=module.state_line())
        if self.bar.disable and int(module.progress * NOTICES) > self.noticed:
            self.noticed = int(module.progress * NOTICES)
            left = (now - self.since) * (1 - module.progress) / max(module.progress - self.first, 1e-9)
            log.info("%s: %d %%, %s, %s left", self.title, 100 * module.progress, module.state_line(), in_words(left))

    def on_train_end(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        self.bar.stop()

    def on_exception(self, trainer: L.Trainer, pl_module: L.LightningModule, exception: BaseException) -> None:
        self.bar.stop()

    def _begin(self, module: Watched) -> None:
        self.title, self.since, self.first = module.title, time.monotonic(), module.progress
        self.noticed = int(self.first * NOTICES)
        self.bar.reset(self.task, total=1.0, description=self.title)
        self.bar.update(self.task, completed=self.first)


class GracefulInterrupt(L.Callback):
    """Ctrl-C ends the fit after the present step; what is done is then written as at the end.

    Args:
        promise: what will happen then, for the log.
    """

    def __init__(self, promise: str) -> None:
        self.promise = promise
        self.requested = False
        self.handler = ExitStack()

    def on_train_start(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        self.handler.enter_context(interruptible(self._request, self.promise))

    def on_train_batch_end(self, trainer: L.Trainer, pl_module: L.LightningModule, *_: object) -> None:
        module = cast(Watched, pl_module)
        if self.requested and can_continue(trainer, module):
            module.stop, trainer.should_stop = INTERRUPTED, True

    def on_train_end(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        self.handler.close()

    def on_exception(self, trainer: L.Trainer, pl_module: L.LightningModule, exception: BaseException) -> None:
        self.handler.close()

    def _request(self) -> None:
        self.requested = True


class TimedCheckpoint(Checkpoint):
    """Keeps one file from which an interrupted fit continues exactly; a finished fit does not leave it behind.

    Lightning calls callbacks of this kind after all others, so the file knows what those have done in the step.

    Args:
        path: the file.
        every: seconds between two of them; None writes it only when the fit is interrupted.
    """

    def __init__(self, path: Path, every: float | None) -> None:
        self.path = path
        self.every = math.inf if every is None else every
        self.last = time.monotonic()

    def on_train_batch_end(self, trainer: L.Trainer, pl_module: L.LightningModule, *_: object) -> None:
        module = cast(Watched, pl_module)
        due = module.stop == INTERRUPTED or (not module.stop and time.monotonic() - self.last > self.every)
        if due and can_continue(trainer, module):
            with replacing(self.path) as temporary:
                trainer.save_checkpoint(temporary)
            self.last = time.monotonic()

    def on_train_end(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        if cast(Watched, pl_module).stop != INTERRUPTED:
            self.path.unlink(missing_ok=True)


class MovingAverage(WeightAveraging):
    """An exponential moving average of the weights, which is validated and left in place of them at the end.

    Args:
        decay: share of the old weights that the average keeps at each step, below 1; early averages forget faster, as
            they are mostly of random weights.
    """

    def __init__(self, decay: float) -> None:
        def average(averages: Any, weights: Any, count: Any) -> None:
            kept = min(decay, (1 + int(count)) / (10 + int(count)))
            get_ema_multi_avg_fn(kept)(averages, weights, count)

        super().__init__(multi_avg_fn=average)


def can_continue(trainer: L.Trainer, module: Watched) -> bool:
    """Whether a checkpoint of this moment can be continued: between two epochs Lightning's counters cannot."""
    return module.progress < 1 and not trainer.is_last_batch


def in_words(seconds: float) -> str:
    """``40 s``, ``7 min`` or ``1.5 h``, with two digits."""
    size, unit = (1, "s") if seconds < 90 else (60, "min") if seconds < 5400 else (3600, "h")
    return f"{float(f'{seconds / size:.2g}'):g} {unit}"
