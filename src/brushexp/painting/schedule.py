"""Where a painting stands: which step of which stage, and how many seconds of the wall and the CPU the steps took."""

import time
from collections.abc import Callable, Sequence
from itertools import accumulate
from typing import Any


class Schedule:
    """So many steps of each of the stages that follow one another; goals move their ends.

    >>> schedule = Schedule([4, 3])
    >>> schedule.step = 5
    >>> schedule.stage, schedule.stage_progress, schedule.steps
    (1, (1, 3), 7)
    """

    def __init__(self, steps: Sequence[int]) -> None:
        self.ends = list(accumulate(steps))  # step at which each stage is over
        self.step = 0  # steps that are done
        self.clock: Callable[[], float] = time.monotonic  # seconds of wall time
        self.cpu_clock: Callable[[], float] = time.process_time  # seconds of all threads of this process
        self._seconds = self._cpu_seconds = 0.0  # in fits that are over
        self._since: tuple[float, float] | None = None  # both clocks at the beginning of the present fit

    @property
    def steps(self) -> int:
        return self.ends[-1]

    @property
    def stage(self) -> int:
        """Number of the present stage; after the last step, of the last one."""
        return next((k for k, end in enumerate(self.ends) if self.step < end), len(self.ends) - 1)

    @property
    def is_last_stage(self) -> bool:
        return self.stage == len(self.ends) - 1

    @property
    def stage_progress(self) -> tuple[int, int]:
        """Steps of the present stage that are done, and all of them."""
        begin = self.ends[self.stage - 1] if self.stage else 0
        return self.step - begin, self.ends[self.stage] - begin

    @property
    def seconds(self) -> float:
        """Wall time in the fits until now."""
        return self._seconds + (0.0 if self._since is None else self.clock() - self._since[0])

    @property
    def cpu_seconds(self) -> float:
        """CPU time of all threads in the fits until now."""
        return self._cpu_seconds + (0.0 if self._since is None else self.cpu_clock() - self._since[1])

    def start(self) -> None:
        """A fit begins, until `pause`."""
        self._since = self.clock(), self.cpu_clock()

    def pause(self) -> None:
        self._seconds, self._cpu_seconds, self._since = self.seconds, self.cpu_seconds, None

    def end_stage(self) -> bool:
        """Leave out what is left of the present stage; False if it is the last one."""
        if self.is_last_stage:
            return False
        stage, (done, steps) = self.stage, self.stage_progress
        self.ends[stage:] = [end - (steps - done) for end in self.ends[stage:]]
        return True

    def state_dict(self) -> dict[str, Any]:
        numbers = {"step": self.step, "seconds": self.seconds, "cpu_seconds": self.cpu_seconds}
        return {"ends": list(self.ends)} | numbers

    def load_state_dict(self, state: dict[str, Any]) -> None:
        self.ends, self.step = [*map(int, state["ends"])], int(state["step"])
        self._seconds, self._cpu_seconds = float(state["seconds"]), float(state["cpu_seconds"])
