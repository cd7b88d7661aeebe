"""Define the callbacks of every fit: a progress bar, timed checkpoints and a response to Ctrl-C.

The callbacks read these members of a LightningModule: ``title`` (of the progress bar), ``progress`` (0 to 1),
``state_line()`` (step, loss and quality in a few words) and ``stop`` (why the fit ends early, or None). They also set
``stop``.
"""

import logging
import math
import time
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from threading import Event
from typing import Any

import lightning as L
from lightning.pytorch.callbacks import Checkpoint, Timer

from brushexp.errors import UserError
from brushexp.system.files import replacing
from brushexp.system.progress import showing
from brushexp.system.runtime import interruptible
from brushexp.system.status import Status

log = logging.getLogger(__name__)
FIRST_CHECKPOINT = 10  # longest time in seconds before the first checkpoint
# Seconds between two updates of the bar, as between two points of a curve, so that both show the PSNR of the same step.
REFRESH_SECONDS = 0.25


class ProgressBar(L.Callback):
    """A progress bar with the module's state and the remaining time, or a few log lines if there is no terminal."""

    def __init__(self) -> None:
        self.bar, self.title, self.refreshed = ExitStack(), "", -math.inf

    def on_train_start(self, trainer: L.Trainer, pl_module: Any) -> None:
        self._begin(pl_module)

    def on_train_batch_end(self, trainer: L.Trainer, pl_module: Any, *_: object) -> None:
        if time.monotonic() - self.refreshed < REFRESH_SECONDS and pl_module.progress < 1:
            return
        self.refreshed = time.monotonic()
        if pl_module.title != self.title:
            self._begin(pl_module)
        self.show(pl_module.progress, pl_module.state_line())

    def on_train_end(self, *_: object) -> None:
        self.bar.close()

    def on_exception(self, *_: object) -> None:
        self.bar.close()

    def _begin(self, pl_module: Any) -> None:
        self.bar.close()
        self.title = pl_module.title
        self.show = self.bar.enter_context(showing(self.title, pl_module.progress))


class TimedCheckpoint(Checkpoint):
    """A callback that writes checkpoints for exact resumption and, on Ctrl-C, ends the fit after the current step.

    If ``path`` is given, a checkpoint is written there every ``every`` seconds, or only on interruption if ``every`` is
    None. Lightning calls callbacks of this type after all others, so the file holds their states after the step.
    """

    def __init__(self, path: Path | None, every: float | None) -> None:
        self.path = path
        self.every = math.inf if every is None or path is None else every
        self.due = time.monotonic() + min(self.every, FIRST_CHECKPOINT)
        self.pressed, self.handler = Event(), ExitStack()
        self.loaded: Sequence[dict[str, Any]] = ()

    def on_load_checkpoint(self, trainer: L.Trainer, pl_module: Any, checkpoint: dict[str, Any]) -> None:
        self.loaded = checkpoint["loops"]["fit_loop"]["state_dict"].get("combined_loader", ())

    def on_train_start(self, trainer: L.Trainer, *_: object) -> None:
        for state in self.loaded:  # Lightning loses it if a file was written at the end of an epoch
            trainer.train_dataloader.load_state_dict(state)  # type: ignore[union-attr]
        promise = "stopping after this step" + "; the result so far will be written" * (self.path is not None)
        self.handler.enter_context(interruptible(self.pressed.set, promise))

    def on_train_batch_end(self, trainer: L.Trainer, pl_module: Any, *_: object) -> None:
        if not trainer.is_last_batch:  # Lightning's counters cannot continue from the last batch
            self._act(trainer, pl_module)

    def on_train_epoch_end(self, trainer: L.Trainer, pl_module: Any) -> None:
        if trainer.num_training_batches == 1:  # an epoch has only one batch
            self._act(trainer, pl_module)

    def _act(self, trainer: L.Trainer, pl_module: Any) -> None:
        if pl_module.progress >= 1:
            return
        if self.pressed.is_set() and not pl_module.stop:
            pl_module.stop, trainer.should_stop = Status.INTERRUPTED, True
        if pl_module.stop == Status.INTERRUPTED or (time.monotonic() > self.due and not pl_module.stop):
            self._write(trainer)
            self.due = time.monotonic() + self.every

    def _write(self, trainer: L.Trainer) -> None:
        if self.path is None:
            return
        try:
            with replacing(self.path) as temporary:
                trainer.save_checkpoint(temporary)
            for logger in trainer.loggers:
                logger.save()  # a resumed run rewrites later values
        except UserError as error:  # the disk may have space again later
            log.warning("could not write a checkpoint at step %d: %s", trainer.global_step, error)

    def on_train_end(self, *_: object) -> None:
        self.handler.close()

    def on_exception(self, *_: object) -> None:
        self.handler.close()

    def on_fit_end(self, trainer: L.Trainer, pl_module: Any) -> None:
        if not pl_module.stop and pl_module.progress < 1:
            pl_module.stop = find_limit(trainer)


def find_limit(trainer: L.Trainer) -> Status:
    """Return the Trainer limit that ended a fit, or `Status.STOPPED_EARLY` if a callback ended it."""
    times = [timer.time_remaining() for timer in trainer.callbacks if isinstance(timer, Timer)]  # type: ignore[attr-defined]
    limits = {
        Status.MAX_STEPS_REACHED: 0 <= trainer.max_steps <= trainer.global_step,
        Status.MAX_EPOCHS_REACHED: trainer.max_epochs is not None and 0 <= trainer.max_epochs <= trainer.current_epoch,
        Status.MAX_TIME_REACHED: any(seconds is not None and seconds <= 0 for seconds in times),
    }
    return next((limit for limit, is_reached in limits.items() if is_reached), Status.STOPPED_EARLY)
