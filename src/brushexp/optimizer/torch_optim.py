"""Any optimiser of torch.optim."""

from collections.abc import Callable, Iterable
from typing import Any

from torch import nn, optim

from brushexp.errors import UserError
from brushexp.optimizer._schedule import UNITS, Schedule, check_rate, share_of_rate
from brushexp.optimizer.base import Optimizer
from brushexp.registry import register


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
        check_rate(lr, hold, warmup)
        self.kind: Callable[..., optim.Optimizer] = Lbfgs if kind is optim.LBFGS else kind
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
        return self.lr * share_of_rate(progress, self.schedule, self.hold, self.warmup)


class Lbfgs(optim.LBFGS):
    """That of PyTorch, which holds on to its first parameters, for strokes that come and go."""

    def step(self, closure: Any = None) -> Any:
        self._params = self.param_groups[0]["params"]
        self._numel_cache = None
        return super().step(closure)
