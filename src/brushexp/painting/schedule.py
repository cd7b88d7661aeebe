"""Where a painting stands: which step of which stage, and how many seconds the steps have taken."""

import time
from collections import UserList
from collections.abc import Callable, Sequence
from itertools import accumulate
from typing import Any

STEPS_PER_EPOCH = 100


class Epoch(UserList[int]):
    """What Lightning calls an epoch: so many steps, of no data. The plan ends a fit, mostly in the midst of one."""

    def state_dict(self) -> dict[str, Any]:
        return {}  # Lightning counts the steps, but resumes in the midst of an epoch only with this

    def load_state_dict(self, state: dict[str, Any]) -> None:
        pass


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
        self._seconds = 0.0  # of wall time in fits that are over
        self._since: float | None = None  # beginning of the present fit

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
        return self._seconds + (0.0 if self._since is None else self.clock() - self._since)

    def start(self) -> None:
        """A fit begins, until `pause`."""
        self._since = self.clock()

    def pause(self) -> None:
        self._seconds, self._since = self.seconds, None

    def end_stage(self) -> bool:
        """Leave out what is left of the present stage; False if it is the last one."""
        if self.is_last_stage:
            return False
        stage, (done, steps) = self.stage, self.stage_progress
        self.ends[stage:] = [end - (steps - done) for end in self.ends[stage:]]
        return True

    def state_dict(self) -> dict[str, Any]:
        return {"ends": list(self.ends), "step": self.step, "seconds": self.seconds}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        self.ends, self.step, self._seconds = [*map(int, state["ends"])], int(state["step"]), float(state["seconds"])
