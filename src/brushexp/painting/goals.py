"""Every way in which a run ends before its last step: time spent, quality reached, nothing gained.

What a run ended with is its ``status`` in metrics.json: ``completed`` (all steps were taken), ``interrupted`` (by the
user, and to be continued), or one of those here.
"""

from __future__ import annotations

import logging
import math
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Sequence
from itertools import accumulate, pairwise
from typing import Any

import lightning as L

from brushexp.errors import UserError
from brushexp.painting.cost import Cost
from brushexp.painting.metrics import psnr_of
from brushexp.painting.painter import Painter
from brushexp.painting.progress import INTERRUPTED

log = logging.getLogger(__name__)
STOPPED_EARLY = "stopped early"  # nothing was gained any more
PSNR_REACHED = "psnr reached"
SECONDS_SPENT = "seconds spent"
WINDOW = 100  # evaluations of the losses over which early_stop asks for a gain
MOST_OF_LAST = 0.5  # share of the seconds that the last of several stages gets at most
LATELY = 0.2  # share of a stage's time so far from which its speed is read
AT_LEAST = 0.25  # seconds of it
SETTLED = 1.0  # seconds after which what was expected no longer counts


class Goal(ABC):
    """Looks at a painter after every step and says when it is enough."""

    def begin(self, painter: Painter) -> None:  # noqa: B027
        """Look before the first step, or before the first one after an interruption."""

    @abstractmethod
    def look(self, painter: Painter) -> None:
        """Look after a step; end a stage with ``painter.end_stage()``, or the run by setting ``painter.stop``."""

    def end(self, painter: Painter) -> None:  # noqa: B027
        """Look after the last step."""

    def state_dict(self) -> dict[str, Any]:
        """What an interrupted run needs to go on as if nothing had happened."""
        return {}

    def load_state_dict(self, state: dict[str, Any]) -> None:  # noqa: B027
        """Take over what `state_dict` gave."""


class EarlyStop(Goal):
    """Ends a stage when 100 evaluations no longer gain ``gain`` dB, and with the last one the run.

    Evaluations and not steps, because a step of L-BFGS looks at the picture several times.
    """

    def __init__(self, gain: float) -> None:
        self.gain = gain
        self.before: float | None = None
        self.last = 0  # evaluations at the last comparison
        self.stage = 0

    def look(self, painter: Painter) -> None:
        """Compare with 100 evaluations ago, or as many more as a step has; coarse steps are not judged."""
        if painter.is_coarse or painter.stage != self.stage:
            self.before, self.last, self.stage = None, painter.evaluations, painter.stage
        if painter.evaluations - self.last < WINDOW:
            return
        now = psnr_of(painter.error)
        if self.before is not None and now - self.before < self.gain and not painter.end_stage():
            painter.stop = STOPPED_EARLY
        self.before, self.last = now, painter.evaluations

    def state_dict(self) -> dict[str, Any]:
        return {"before": self.before, "last": self.last, "stage": self.stage}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        self.before, self.last, self.stage = state["before"], state["last"], state["stage"]


class Quality(Goal):
    """Ends the run when the picture as last seen, that is before the last step, has a PSNR of ``psnr`` dB.

    Only the last stage counts: what the renderers before it show is not what the run leaves.
    """

    def __init__(self, psnr: float) -> None:
        self.psnr = psnr

    def look(self, painter: Painter) -> None:
        last = painter.stage == len(painter.ends) - 1
        seen = painter.progress[0] > 0 and not painter.is_coarse  # by the renderer of this stage, in full
        if last and seen and psnr_of(painter.error) >= self.psnr:
            painter.stop = PSNR_REACHED
            log.info("psnr=%g is reached after %.1f s and %d steps", self.psnr, painter.elapsed, painter.step)

    def end(self, painter: Painter) -> None:
        if painter.stop not in (PSNR_REACHED, INTERRUPTED):
            log.warning("psnr=%g was not reached: the picture has %.2f dB", self.psnr, psnr_of(painter.error))


class Budget(Goal):
    """Fits the number of steps to ``seconds`` of optimisation, so that schedules come to their end with them.

    After every step the steps that are left are those that fit into the time left, at the speed of the last fifth of
    the stage: steps get dearer and cheaper while strokes move, come and go. The last of several stages keeps its steps
    if they fit into half of the time; the others share the rest as they would have taken it. In a run that was
    interrupted the time before counts.

    Args:
        seconds: of wall time; the quantity that metrics.json calls ``seconds``.
        costs: what each stage is expected to take, until it has been seen.
    """

    def __init__(self, seconds: float, costs: Sequence[Cost]) -> None:
        if not math.isfinite(seconds):
            raise UserError(f"seconds={seconds:g} is not a time; set seconds to a number, or to null and give steps")
        self.seconds = seconds
        self.costs = list(costs)
        self.deadlines: list[float] = []  # seconds at which each stage should be over
        self._stage = 0
        self._since = 0.0  # seconds at which this stage began
        self._seen: deque[tuple[float, int]] = deque()  # moments of this stage, lately: seconds, steps

    def begin(self, painter: Painter) -> None:
        if not self.deadlines:
            self.deadlines = self._divided([end - begin for begin, end in pairwise([0, *painter.ends])])
        self._stage, self._since = painter.stage, painter.elapsed
        self._seen = deque([(painter.elapsed, painter.step)])
        self._fit(painter)

    def look(self, painter: Painter) -> None:
        now = painter.elapsed
        if painter.stage != self._stage:  # its first step is not like the others: the renderer takes over
            self._stage, self._since = painter.stage, now
            self._seen.clear()
        else:
            self._seen.append((now, painter.step))
        lately = max(AT_LEAST, LATELY * (now - self._since))
        while len(self._seen) > 2 and self._seen[1][0] <= now - lately:
            self._seen.popleft()
        self._fit(painter)

    def end(self, painter: Painter) -> None:
        if painter.step >= painter.steps and not painter.stop:
            painter.stop = SECONDS_SPENT
            log.info("seconds=%g are spent after %d steps", self.seconds, painter.step)

    def state_dict(self) -> dict[str, Any]:
        return {"deadlines": self.deadlines}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        self.deadlines = state["deadlines"]

    def _divided(self, steps: Sequence[int]) -> list[float]:
        """The deadlines of stages that are planned to have so many steps each."""
        *first, last = (cost.seconds(max(n, 1)) for cost, n in zip(self.costs, steps, strict=True))
        last = min(last, MOST_OF_LAST * self.seconds) if first else self.seconds
        factor = (self.seconds - last) / sum(first) if first else 1
        return list(accumulate([*(factor * share for share in first), last]))

    def _fit(self, painter: Painter) -> None:
        """Set the ends of the present stage and of those after it."""
        stage = self._stage
        step = self.costs[stage].step
        if len(self._seen) > 1:
            (since, before), (until, after) = self._seen[0], self._seen[-1]
            expected = max(0.0, SETTLED - (until - self._since))
            step = (expected + until - since) / (expected / max(step, 1e-9) + after - before)
        here = Cost(step).steps(self.deadlines[stage] - painter.elapsed)
        spans = (due - begin for begin, due in pairwise(self.deadlines[stage:]))
        later = (cost.steps(span) for cost, span in zip(self.costs[stage + 1 :], spans, strict=True))
        painter.ends[stage:] = accumulate([painter.step + here, *later])


class Goals(L.Callback):
    """The goals of a run, looked at after every step and kept in the checkpoint; None is no goal.

    Args:
        early_stop: dB, see `EarlyStop`.
        psnr: dB, see `Quality`.
        seconds: see `Budget`.
        costs: what each stage is expected to take; read only with ``seconds``.
    """

    def __init__(
        self,
        *,
        early_stop: float | None = None,
        psnr: float | None = None,
        seconds: float | None = None,
        costs: Sequence[Cost] = (),
    ) -> None:
        self.goals: dict[str, Goal] = {}
        if early_stop is not None:
            self.goals["early_stop"] = EarlyStop(early_stop)
        if psnr is not None:
            self.goals["psnr"] = Quality(psnr)
        if seconds is not None:
            self.goals["seconds"] = Budget(seconds, costs)

    def look(self, painter: Painter) -> None:
        """Look after a step."""
        for goal in self.goals.values():
            goal.look(painter)

    def on_fit_start(self, trainer: L.Trainer, painter: L.LightningModule) -> None:
        assert isinstance(painter, Painter)
        for goal in self.goals.values():
            goal.begin(painter)

    def on_fit_end(self, trainer: L.Trainer, painter: L.LightningModule) -> None:
        assert isinstance(painter, Painter)
        for goal in self.goals.values():
            goal.end(painter)

    def state_dict(self) -> dict[str, Any]:
        return {name: goal.state_dict() for name, goal in self.goals.items()}

    def load_state_dict(self, state_dict: dict[str, Any]) -> None:
        for name, goal in self.goals.items():
            goal.load_state_dict(state_dict[name])
