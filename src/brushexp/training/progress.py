"""What goes on beside the training of a renderer: the bar, pictures of held-out strokes, checkpoints, Ctrl-C."""

from __future__ import annotations

import logging
import math
import time
from pathlib import Path

import lightning as L
import torch
from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn
from torch import Tensor

from brushexp.system.files import replacing, write_picture
from brushexp.training.trainer import RendererTrainer

log = logging.getLogger(__name__)
INTERRUPTED = "interrupted"
COLUMNS = 6  # pairs in a row of the sheet of held-out strokes
SHOWN_SIDE = 128  # pixels that a window has at least on that sheet
GAP = 8  # pixels between pairs
NOTICES = 10  # lines in the log of a run, where there is no terminal for a bar


class ProgressBar(L.Callback):
    """A bar with L2, PSNR, strokes/s and time left; a few lines in the log where there is no terminal."""

    def __init__(self) -> None:
        console = Console(stderr=True)
        self.bar = Progress(
            TextColumn("training"),
            BarColumn(),
            TaskProgressColumn(),
            TextColumn("{task.fields[state]}"),
            TimeElapsedColumn(),
            TextColumn("{task.fields[left]}"),
            console=console,
            disable=not console.is_terminal,
            transient=True,
        )
        self.noticed = 0

    def on_fit_start(self, trainer: L.Trainer, module: L.LightningModule) -> None:
        self.bar.start()
        self.task = self.bar.add_task("training", total=1.0, state="", left="")

    def on_train_batch_end(self, trainer: L.Trainer, module: L.LightningModule, *_: object) -> None:
        assert isinstance(module, RendererTrainer)
        left = f"{_clock(module.seconds * (1 / module.progress - 1))} left" if module.progress > 0 else ""
        self.bar.update(self.task, completed=module.progress, state=module.state_line(), left=left)
        if self.bar.disable and int(module.progress * NOTICES) > self.noticed:
            self.noticed = int(module.progress * NOTICES)
            log.info("%d %% (step %d): %s, %s", 100 * module.progress, module.step, module.state_line(), left)

    def on_fit_end(self, trainer: L.Trainer, module: L.LightningModule) -> None:
        self.bar.stop()

    def on_exception(self, trainer: L.Trainer, module: L.LightningModule, exception: BaseException) -> None:
        self.bar.stop()


class HeldOutPictures(L.Callback):
    """After every validation ``pictures/epoch_XXX.png``: held-out strokes, each drawn beside the truth.

    Args:
        folder: of the run; the latest sheet is also there as ``validation.png``.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def on_validation_end(self, trainer: L.Trainer, module: L.LightningModule) -> None:
        assert isinstance(module, RendererTrainer)
        if module.examples is None:
            return
        picture = sheet_of_pairs(*module.examples)
        (self.folder / "pictures").mkdir(exist_ok=True)
        write_picture(self.folder / "pictures" / f"epoch_{trainer.current_epoch:03d}.png", picture)
        write_picture(self.folder / "validation.png", picture)


class Checkpoints(L.Callback):
    """Ends an interrupted fit; keeps a file from which it continues exactly.

    Args:
        path: the file.
        every: seconds between two of them; None keeps one only when the run is interrupted.
    """

    def __init__(self, path: Path, every: float | None) -> None:
        self.path = path
        self.every = math.inf if every is None else every
        self.last = time.monotonic()

    def on_train_batch_end(self, trainer: L.Trainer, module: L.LightningModule, *_: object) -> None:
        assert isinstance(module, RendererTrainer)
        if trainer.is_last_batch or module.progress >= 1:
            return  # at the end of an epoch Lightning's counters stand between two epochs
        if module.stop or time.monotonic() - self.last > self.every:
            with replacing(self.path) as temporary:
                trainer.save_checkpoint(temporary)
            self.last = time.monotonic()
        if module.stop:
            trainer.should_stop = True


def sheet_of_pairs(drawn: Tensor, truth: Tensor) -> Tensor:
    """Pairs over white, drawn on the left and true on the right, in rows of `COLUMNS`: (3, H, W).

    Args:
        drawn: (n, 4, S, S) RGBA, straight alpha.
        truth: the same.
    """
    pairs = torch.cat([drawn, truth], dim=3)
    white = pairs[:, :3] * pairs[:, 3:] + 1 - pairs[:, 3:]
    zoom = max(2, -(-SHOWN_SIDE // drawn.shape[-1]))
    white = white.repeat_interleave(zoom, 2).repeat_interleave(zoom, 3)
    missing = -len(white) % COLUMNS
    white = torch.cat([white, white.new_ones(missing, *white.shape[1:])])
    framed = torch.nn.functional.pad(white, (0, GAP, 0, GAP), value=0.5)
    rows = [torch.cat(list(row), dim=2) for row in framed.split(COLUMNS)]
    return torch.cat(rows, dim=1)


def _clock(seconds: float) -> str:
    """1:05 or 2:00:31."""
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{rest:02d}" if hours else f"{minutes}:{rest:02d}"
