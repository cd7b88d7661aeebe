"""Goals that end a stage or a run early, and record the reason as the ``status`` in metrics.json."""

import logging
from collections import deque
from itertools import accumulate, pairwise
from typing import Any

import lightning as L
import torch
from lightning.pytorch.callbacks import EarlyStopping

from brushexp.pictures.similarity import psnr_of
from brushexp.system.status import Status

log = logging.getLogger(__name__)
GAIN_EVALUATIONS = 100  # evaluations of the losses between two checks of early_stop
LAST_STAGE_SHARE = 0.5  # share of the seconds for the last of several stages
RECENT_SHARE = 0.2  # most recent share of a stage's time over which its speed is measured
ROUNDING = 1 / 12 / 255**2  # mean squared error of rounding to 8 bits
RECENT_SECONDS = 0.25  # shortest time over which speed is measured


class NoMoreGain(EarlyStopping):
    """Ends a stage when 100 evaluations improve PSNR by less than ``gain`` dB (Lightning's EarlyStopping).

    Evaluations of the losses are counted instead of steps, because an L-BFGS step evaluates them several times. Coarse
    steps and steps with surplus strokes do not count.
    """

    def __init__(self, gain: float) -> None:
        super().__init__("psnr", min_delta=gain, patience=1, mode="max", check_on_train_epoch_end=True)
        self.last = 0  # number of evaluations at the last comparison
        self.stage = 0

    def on_train_batch_end(self, trainer: L.Trainer, painter: Any, *_: object) -> None:
        if painter.is_unready or painter.schedule.stage != self.stage:
            self.last, self.stage = painter.evaluations, painter.schedule.stage
            self.best_score = torch.tensor(-torch.inf)
        if painter.evaluations - self.last < GAIN_EVALUATIONS or trainer.should_stop:
            return
        self.last = painter.evaluations
        super().on_train_epoch_end(trainer, painter)
        if trainer.should_stop and painter.schedule.end_stage():
            trainer.should_stop = False

    def on_train_epoch_end(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        """Do nothing, because evaluations are counted instead of epochs."""

    def state_dict(self) -> dict[str, Any]:
        return {**super().state_dict(), "last": self.last, "stage": self.stage}

    def load_state_dict(self, state_dict: dict[str, Any]) -> None:
        super().load_state_dict(state_dict)
        self.last, self.stage = state_dict["last"], state_dict["stage"]


class Quality(L.Callback):
    """Ends the run when the picture before a step, drawn by the last renderer at 8 bits, has ``psnr`` dB or more."""

    def __init__(self, psnr: float) -> None:
        self.psnr = psnr

    def on_train_batch_end(self, trainer: L.Trainer, painter: Any, *_: object) -> None:
        schedule = painter.schedule
        in_full = schedule.stage_progress[0] > 0 and not painter.is_unready  # judged with the renderer of this stage
        if schedule.is_last_stage and in_full and psnr_of(painter.picture.error + ROUNDING) >= self.psnr:
            painter.stop = Status.PSNR_REACHED
            log.info("psnr=%g was reached after %.1f s and %d steps", self.psnr, schedule.seconds, schedule.step)

    def on_train_end(self, trainer: L.Trainer, painter: Any) -> None:
        if painter.stop not in (Status.PSNR_REACHED, Status.INTERRUPTED):
            log.warning("psnr=%g was not reached; the picture has %.2f dB", self.psnr, psnr_of(painter.picture.error))


class TimeBudget(L.Callback):
    """Adapts the number of steps to ``seconds`` of optimisation, so that schedules are completed in time.

    After every step, it plans as many further steps as fit into the remaining time at the speed measured over the most
    recent fifth of the stage. The last of several stages gets half of the time; the others share the rest in proportion
    to their steps.
    """

    def __init__(self, seconds: float) -> None:
        self.seconds = seconds
        self.deadlines: list[float] = []  # seconds at which each stage should end
        self._stage = 0
        self._since = 0.0  # seconds at which this stage began
        self._recent: deque[tuple[float, int]] = deque()  # (seconds, step) of the last steps of this stage

    def on_fit_start(self, trainer: L.Trainer, painter: Any) -> None:
        """Divide the time among the stages, and plan at least one step for each unless ``seconds`` is 0."""
        schedule = painter.schedule
        if not self.deadlines:
            ends, rest = schedule.ends, (1 - LAST_STAGE_SHARE) * self.seconds
            self.deadlines = [*(rest * end / max(ends[-2], 1) for end in ends[:-1]), self.seconds]
            if self.seconds:
                schedule.ends = list(accumulate(max(1, end - begin) for begin, end in pairwise([0, *ends])))
            else:
                schedule.ends = [schedule.step] * len(ends)
        self._stage, self._since = schedule.stage, schedule.seconds
        self._recent = deque([(schedule.seconds, schedule.step)])

    def on_train_batch_end(self, trainer: L.Trainer, painter: Any, *_: object) -> None:
        schedule = painter.schedule
        now = schedule.seconds
        if schedule.stage != self._stage:
            self._stage, self._since = schedule.stage, now
            self._recent.clear()
        self._recent.append((now, schedule.step))
        recent = max(RECENT_SECONDS, RECENT_SHARE * (now - self._since))
        while len(self._recent) > 2 and self._recent[1][0] <= now - recent:
            self._recent.popleft()
        (since, before), (until, after) = self._recent[0], self._recent[-1]
        if after > before:
            steps = (self.deadlines[self._stage] - now) * (after - before) / max(until - since, 1e-9)
            shift = schedule.step + max(0, round(steps)) - schedule.ends[self._stage]
            schedule.ends[self._stage :] = [end + shift for end in schedule.ends[self._stage :]]

    def on_train_end(self, trainer: L.Trainer, painter: Any) -> None:
        if painter.schedule.step >= painter.schedule.steps and not painter.stop:
            painter.stop = Status.SECONDS_SPENT
            log.info("seconds=%g: time was up after %d steps", self.seconds, painter.schedule.step)

    def state_dict(self) -> dict[str, Any]:
        return {"deadlines": self.deadlines}

    def load_state_dict(self, state_dict: dict[str, Any]) -> None:
        self.deadlines = state_dict["deadlines"]


class SecondsLimit(L.Callback):
    """Ends the run after ``seconds`` of optimisation, for painters that do not plan their steps."""

    def __init__(self, seconds: float) -> None:
        self.seconds = seconds

    def on_train_batch_end(self, trainer: L.Trainer, painter: Any, *_: object) -> None:
        if painter.schedule.seconds >= self.seconds and not painter.is_done:
            painter.stop = painter.stop or Status.SECONDS_SPENT
            log.info("seconds=%g: time was up after step %d", self.seconds, painter.schedule.step)


def goals_of(
    *, early_stop: float | None, psnr: float | None, seconds: float | None, has_plan: bool = True
) -> list[L.Callback]:
    """Create the goals of a run, one for each value that is not None.

    The number of steps is adapted to ``seconds`` only if the painter plans its steps (``has_plan``).
    """
    goals = ((NoMoreGain, early_stop), (Quality, psnr), (TimeBudget if has_plan else SecondsLimit, seconds))
    return [goal(value) for goal, value in goals if value is not None]
