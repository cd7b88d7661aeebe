"""Any optimiser of the library pytorch-optimizer."""

import inspect
from collections.abc import Callable, Iterable
from typing import Any

from torch import nn, optim

from brushexp.errors import UserError
from brushexp.optimizer._schedule import UNITS, Schedule, check_rate, share_of_rate
from brushexp.optimizer.base import Optimizer
from brushexp.registry import register


@register("optimizer", "pytorch_optimizer")
class PytorchOptimizer(Optimizer):
    """Any class of the library pytorch-optimizer by name (an extra), e.g. SOAP; else as optimizer=torch.

    Classes that need second derivatives of the picture (AdaHessian, SophiaH) find none: the compiled blend has only
    first ones.

    Args:
        name: class in pytorch_optimizer, e.g. SOAP, Kron, Adan.
        lr: learning rate; see ``units`` for what it means to each field.
        units: field -> unit, as in `torch_optim.TorchOptim`. 0 freezes a field.
        schedule: constant, linear (to 0) or cosine (to 0), after ``hold``.
        hold: fraction of the steps at the full rate before it falls.
        warmup: fraction of the steps over which the rate first rises from 0.
        options: further arguments of the class. A field of N strokes is a tensor (N, 2), (N, 3) or (N,), so what keeps
            a matrix per side must be told to leave out the side of N.
    """

    def __init__(
        self,
        *,
        name: str = "SOAP",
        lr: float = 0.02,
        units: dict[str, float] = UNITS,
        schedule: Schedule = Schedule.linear,
        hold: float = 0.5,
        warmup: float = 0.0,
        options: dict[str, Any] = {},  # noqa: B006
    ) -> None:
        check_rate(lr, hold, warmup)
        self.kind = _class_of(name)
        known = inspect.signature(self.kind).parameters
        for key in options:  # the library drops what it does not know
            if key not in known or key == "lr":
                choices = ", ".join(k for k in known if k not in ("params", "lr", "kwargs"))
                raise UserError(f"optimizer.options has {key!r}, which {name} does not take; it takes {choices}")
        self.name = name
        self.lr = lr
        self.units = units
        self.schedule = schedule
        self.hold = hold
        self.warmup = warmup
        self.options = options

    def over(self, parameters: Iterable[nn.Parameter]) -> optim.Optimizer:
        try:
            optimizer = self.kind(parameters, lr=self.lr, **self.options)
        except (TypeError, ValueError) as error:
            raise UserError(f"pytorch_optimizer.{self.name}: {error}; see optimizer.options") from error
        for group in optimizer.param_groups:
            group.setdefault("step", 0)  # what the library counts from, but missing until the first step
        return optimizer

    def rate(self, progress: float) -> float:
        return self.lr * share_of_rate(progress, self.schedule, self.hold, self.warmup)


def _class_of(name: str) -> Callable[..., optim.Optimizer]:
    try:
        import pytorch_optimizer  # noqa: PLC0415  (an extra)
    except ImportError as error:
        raise UserError(
            "this optimizer needs the library pytorch-optimizer; pip install 'brushexp[optimizers]'"
        ) from error
    kinds = {
        key: value
        for key, value in vars(pytorch_optimizer).items()
        if isinstance(value, type) and issubclass(value, optim.Optimizer) and value is not optim.Optimizer
    }
    if name not in kinds:
        raise UserError(
            f"pytorch_optimizer has no optimiser {name!r}; set optimizer.name to one of {', '.join(sorted(kinds))}"
        )
    return kinds[name]
