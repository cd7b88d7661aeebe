"""Count the steps, stages and seconds of a painting, and record its quality over time."""

import math
import time
from bisect import bisect_right
from collections.abc import Callable, Sequence
from itertools import accumulate
from typing import Any

MAX_PAIRS = 200  # largest number of pairs (seconds, PSNR) that a run keeps

Pair = tuple[float, float]  # seconds of optimisation, PSNR in dB


class Schedule:
    """Counts the steps of consecutive stages; goals may move the ends of the stages.

    >>> schedule = Schedule([4, 3])
    >>> schedule.step = 5
    >>> schedule.stage, schedule.stage_progress, schedule.steps
    (1, (1, 3), 7)
    """

    def __init__(self, steps: Sequence[int]) -> None:
        self.ends = list(accumulate(steps))  # step at which each stage ends
        self.step = 0  # number of steps taken
        self.clock: Callable[[], float] = time.monotonic  # seconds of wall time
        self.cpu_clock: Callable[[], float] = time.process_time  # seconds of all threads of this process
        self._seconds = self._cpu_seconds = 0.0  # seconds of earlier fits
        self._since: tuple[float, float] | None = None  # both clocks at the start of the current fit

    @property
    def steps(self) -> int:
        return self.ends[-1]

    @property
    def stage(self) -> int:
        """Index of the current stage, or of the last stage after the last step."""
        return min(bisect_right(self.ends, self.step), len(self.ends) - 1)

    @property
    def is_last_stage(self) -> bool:
        return self.stage == len(self.ends) - 1

    @property
    def stage_progress(self) -> tuple[int, int]:
        """Number of steps taken in the current stage, and the stage's total number of steps."""
        stage = self.stage
        begin = self.ends[stage - 1] if stage else 0
        return self.step - begin, self.ends[stage] - begin

    @property
    def seconds(self) -> float:
        """Wall time of all fits so far."""
        return self._seconds + (0.0 if self._since is None else self.clock() - self._since[0])

    @property
    def cpu_seconds(self) -> float:
        """CPU time of all threads in all fits so far."""
        return self._cpu_seconds + (0.0 if self._since is None else self.cpu_clock() - self._since[1])

    def start(self) -> None:
        """Start the clocks, which run until `pause` is called."""
        self._since = self.clock(), self.cpu_clock()

    def pause(self) -> None:
        self._seconds, self._cpu_seconds, self._since = self.seconds, self.cpu_seconds, None

    def end_stage(self) -> bool:
        """Skip the rest of the current stage and return True; return False if it is the last stage."""
        if self.is_last_stage:
            return False
        stage, (done, steps) = self.stage, self.stage_progress
        self.ends[stage:] = [end - (steps - done) for end in self.ends[stage:]]
        return True

    def replan(self, steps: int) -> None:
        """Move the end of the current stage so that all stages together have ``steps`` steps.

        The new end is never before the current step.

        >>> schedule = Schedule([100, 10])
        >>> schedule.step = 30
        >>> schedule.replan(60)
        >>> schedule.ends
        [50, 60]
        """
        stage = self.stage
        shift = max(steps - self.steps, self.step - self.ends[stage])
        self.ends[stage:] = [end + shift for end in self.ends[stage:]]

    def state_dict(self) -> dict[str, Any]:
        seconds = {"seconds": self.seconds, "cpu_seconds": self.cpu_seconds}
        return {"ends": list(self.ends), "step": self.step} | seconds

    def load_state_dict(self, state: dict[str, Any]) -> None:
        self.ends, self.step = [*map(int, state["ends"])], int(state["step"])
        self._seconds, self._cpu_seconds = float(state["seconds"]), float(state["cpu_seconds"])


def add_pair(curve: list[Pair], seconds: float, psnr: float, *, most: int = MAX_PAIRS) -> None:
    """Add a finite PSNR to a curve, replacing the last pair if it has the same time.

    If there are more than ``most`` pairs, the pair that forms the smallest triangle with its two neighbours is removed
    (Visvalingam and Whyatt, 1993), so that bends are kept and straight parts need few pairs. The first and the last
    pair are always kept.
    """
    if not math.isfinite(psnr):
        return
    if curve and seconds <= curve[-1][0]:
        curve.pop()
    curve.append((seconds, psnr))
    if len(curve) > most:
        areas = [_area(*curve[k - 1 : k + 2]) for k in range(1, len(curve) - 1)]
        del curve[1 + areas.index(min(areas))]


def _area(a: Pair, b: Pair, c: Pair) -> float:
    return abs((b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1]))
