"""How the learning rate goes, for every optimiser alike."""

import math
from enum import Enum

# A learning rate of 0.01 moves a control point by a hundredth of a half-window per step of Adam: the thesis's rate.
UNITS = {"position": 1.0, "start": 1.0, "control": 1.0, "end": 1.0, "width": 0.3, "color": 1.0, "opacity": 1.0}


class RateSchedule(Enum):
    """How the learning rate goes from ``lr`` to its end."""

    constant = "constant"
    linear = "linear"
    cosine = "cosine"


def share_of_rate(progress: float, schedule: RateSchedule, hold: float, warmup: float) -> float:
    """Share (0 to 1) of the full rate when ``progress`` (0 to 1) of the steps are done.

    Args:
        progress: fraction of the steps.
        schedule: how it falls after ``hold``.
        hold: fraction of the steps at the full rate before it falls.
        warmup: fraction of the steps over which it first rises from 0.
    """
    rise = min(1.0, (progress + 1e-9) / warmup) if warmup else 1.0
    falling = max(0.0, (progress - hold) / (1 - hold)) if hold < 1 else 0.0
    fall = {
        RateSchedule.constant: 1.0,
        RateSchedule.linear: 1 - falling,
        RateSchedule.cosine: 0.5 * (1 + math.cos(math.pi * falling)),
    }[schedule]
    return rise * fall
