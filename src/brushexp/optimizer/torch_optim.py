"""Any optimiser of torch.optim."""

import math
from collections.abc import Callable, Iterable
from enum import Enum
from typing import Any

from torch import nn, optim

from brushexp.errors import UserError
from brushexp.optimizer.base import Optimizer
from brushexp.registry import register

# A learning rate of 0.01 moves a control point by a hundredth of a half-window per step of Adam: the thesis's rate.
UNITS = {"position": 1.0, "start": 1.0, "control": 1.0, "end": 1.0, "width": 0.3, "color": 1.0, "opacity": 1.0}


class Schedule(Enum):
    """How the learning rate goes from ``lr`` to its end."""

    constant = "constant"
    linear = "linear"
    cosine = "cosine"


@register("optimizer", "torch")
class TorchOptim(Optimizer):
    """Any class of torch.optim by name, with a unit per field and a schedule; the presets name the usual ones.

    Args:
        name: class in torch.optim, e.g. Adam, NAdam, Adagrad.
        lr: learning rate; see ``units`` for what it means to each field.
        units: field -> unit. ``lr`` times the unit is about one step of Adam: half-windows for position and points,
            fractions of the window for width. 0 freezes a field.
        schedule: constant, linear (to 0) or cosine (to 0), after ``hold``.
        hold: fraction of the steps at the full rate before it falls.
        warmup: fraction of the steps over which the rate first rises from 0.
        options: further arguments of the class, e.g. ``{betas: [0.9, 0.99]}``.
    """

    def __init__(
        self,
        *,
        name: str = "Adam",
        lr: float = 0.02,
        units: dict[str, float] = UNITS,
        schedule: Schedule = Schedule.linear,
        hold: float = 0.5,
        warmup: float = 0.0,
        options: dict[str, Any] = {},  # noqa: B006
    ) -> None:
        kind = getattr(optim, name, None)
        if not (isinstance(kind, type) and issubclass(kind, optim.Optimizer)) or kind is optim.Optimizer:
            choices = [key for key, value in vars(optim).items() if isinstance(value, type) and key != "Optimizer"]
            raise UserError(f"torch.optim has no optimiser {name!r}; set optimizer.name to one of {', '.join(choices)}")
        if not (math.isfinite(lr) and lr > 0):
            raise UserError(f"optimizer.lr={lr:g} is not a positive number; try optimizer.lr=0.02")
        for key, value in (("warmup", warmup), ("hold", hold)):
            if not 0 <= value < 1:
                raise UserError(f"optimizer.{key}={value:g} is not a fraction below 1; try optimizer.{key}=0.1")
        self.kind: Callable[..., optim.Optimizer] = kind
        self.name = name
        self.lr = lr
        self.units = units
        self.schedule = schedule
        self.hold = hold
        self.warmup = warmup
        self.options = options

    def over(self, parameters: Iterable[nn.Parameter]) -> optim.Optimizer:
        try:
            return self.kind(parameters, lr=self.lr, **self.options)
        except (TypeError, ValueError) as error:
            raise UserError(f"torch.optim.{self.name}: {error}; see optimizer.options") from error

    def rate(self, progress: float) -> float:
        rise = min(1.0, (progress + 1e-9) / self.warmup) if self.warmup else 1.0
        falling = max(0.0, (progress - self.hold) / (1 - self.hold))
        fall = {
            Schedule.constant: 1.0,
            Schedule.linear: 1 - falling,
            Schedule.cosine: 0.5 * (1 + math.cos(math.pi * falling)),
        }[self.schedule]
        return self.lr * rise * fall
