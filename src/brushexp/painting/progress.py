"""What goes on beside the steps: the bar, frames and checkpoints."""

from __future__ import annotations

import logging
import math
import time
from pathlib import Path
from typing import Any

import lightning as L
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from brushexp.painting.metrics import psnr_of
from brushexp.painting.painter import Painter
from brushexp.painting.timelapse import Timelapse
from brushexp.system.files import replacing

log = logging.getLogger(__name__)
INTERRUPTED = "interrupted"
NOTICES = 5  # lines in the log of a run, where there is no terminal for a bar


class ProgressBar(L.Callback):
    """A bar with steps, loss, PSNR and time left; a few lines in the log where there is no terminal.

    Each stage has its own: a step of one may take a hundred times as long as a step of another.
    """

    def __init__(self) -> None:
        console = Console(stderr=True)
        self.bar = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            TextColumn("{task.fields[state]}"),
            TimeElapsedColumn(),
            TextColumn("left"),
            TimeRemainingColumn(),
            console=console,
            disable=not console.is_terminal,
            transient=True,
        )
        self.stage = self.noticed = 0

    def on_fit_start(self, trainer: L.Trainer, painter: L.LightningModule) -> None:
        assert isinstance(painter, Painter)
        self.bar.start()
        self.task = self.bar.add_task("painting", state="")
        self._begin_stage(painter)

    def on_train_batch_end(self, trainer: L.Trainer, painter: L.LightningModule, *_: object) -> None:
        assert isinstance(painter, Painter)
        if painter.stage != self.stage:
            self._begin_stage(painter)
        state, (done, steps) = _state(painter), painter.progress
        self.bar.update(self.task, completed=done, state=state)
        if self.bar.disable and done * NOTICES // max(steps, 1) > self.noticed:
            self.noticed = done * NOTICES // max(steps, 1)
            log.info("step %d of %d: %s", painter.step, painter.steps, state)

    def _begin_stage(self, painter: Painter) -> None:
        stages, (done, steps) = painter.parts.stages, painter.progress
        self.stage, self.noticed = painter.stage, 0
        description = f"painting with {stages[self.stage].name}" if len(stages) > 1 else "painting"
        self.bar.reset(self.task, total=steps, completed=done, description=description)

    def on_fit_end(self, trainer: L.Trainer, painter: L.LightningModule) -> None:
        self.bar.stop()

    def on_exception(self, trainer: L.Trainer, painter: L.LightningModule, exception: BaseException) -> None:
        self.bar.stop()


def _state(painter: Painter) -> str:
    total = sum(painter.parts.losses[name].weight * float(term) for name, term in painter.terms.items())
    return f"loss {total:.5f}  {psnr_of(painter.error):.2f} dB"


class Frames(L.Callback):
    """Shows the timelapse the frames it wants, and keeps them in the checkpoint."""

    def __init__(self, timelapse: Timelapse) -> None:
        self.timelapse = timelapse

    def look(self, painter: Painter) -> None:
        """Offer the picture as it is now."""
        if self.timelapse.due(painter.step, painter.steps):
            self.timelapse.add(painter.latest(), painter.step)

    def state_dict(self) -> dict[str, Any]:
        return self.timelapse.state_dict()

    def load_state_dict(self, state_dict: dict[str, Any]) -> None:
        self.timelapse.load_state_dict(state_dict)


class Checkpoints(L.Callback):
    """Ends the fit after the last step; keeps a file from which an interrupted run continues exactly.

    Args:
        path: the file; a finished run does not leave it behind.
        every: seconds between two of them; None keeps one only when the run is interrupted.
    """

    def __init__(self, path: Path, every: float | None) -> None:
        self.path = path
        self.every = math.inf if every is None else every
        self.last = time.monotonic()

    def on_train_epoch_end(self, trainer: L.Trainer, painter: L.LightningModule) -> None:
        assert isinstance(painter, Painter)
        finished = painter.step >= painter.steps or painter.stop not in ("", INTERRUPTED)
        if finished:
            self.path.unlink(missing_ok=True)
        elif painter.stop or time.monotonic() - self.last > self.every:
            with replacing(self.path) as temporary:
                trainer.save_checkpoint(temporary)
            self.last = time.monotonic()
        trainer.should_stop = finished or bool(painter.stop)
