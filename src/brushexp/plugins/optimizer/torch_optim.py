"""Any optimiser of torch.optim, or of the library pytorch-optimizer."""

from collections.abc import Iterable
from typing import Annotated, Any

from torch import nn, optim

from brushexp.bounds import above, between
from brushexp.errors import UserError
from brushexp.plugins.optimizer._libraries import Library, class_of
from brushexp.plugins.optimizer._rates import UNITS, RateSchedule, share_of_rate
from brushexp.plugins.optimizer.base import Optimizer
from brushexp.registry import register


@register("optimizer", "torch")
class TorchOptim(Optimizer):
    """Any class of torch.optim by name, with a unit per field and a schedule; the presets name the usual ones.

    Classes that need second derivatives of the picture (AdaHessian, SophiaH) find none: the compiled blend has only
    first ones. A field of N strokes is a tensor (N, 2), (N, 3) or (N,): what keeps a matrix per side must be told by
    ``options`` to leave out the side of N.

    Args:
        name: class in the library, e.g. Adam, NAdam, Adagrad.
        library: torch, or pytorch_optimizer (an extra) with its SOAP, Kron, Adan and a hundred more.
        lr: learning rate; see ``units`` for what it means to each field.
        units: field -> unit. ``lr`` times the unit is about one step of Adam: half-windows for position and points,
            fractions of the window for width. 0 freezes a field.
        schedule: constant, linear (to 0) or cosine (to 0), after ``hold``.
        hold: fraction of the steps at the full rate before it falls; 1: it never falls.
        warmup: fraction of the steps over which the rate first rises from 0.
        options: further arguments of the class, e.g. ``{betas: [0.9, 0.99]}``.
    """

    def __init__(
        self,
        *,
        name: str = "Adam",
        library: Library = Library.torch,
        lr: Annotated[float, above(0)] = 0.02,
        units: dict[str, float] = UNITS,
        schedule: RateSchedule = RateSchedule.linear,
        hold: Annotated[float, between(0, 1)] = 0.5,
        warmup: Annotated[float, between(0, 1)] = 0.0,
        options: dict[str, Any] = {},  # noqa: B006
    ) -> None:
        self.kind = class_of(library, name, options)
        self.name = name
        self.library = library
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
            raise UserError(f"{self.name}: {error}; see optimizer.options") from error
        if self.library is Library.pytorch_optimizer:
            for group in optimizer.param_groups:
                group.setdefault("step", 0)  # what it counts from, but missing until the first step
        return optimizer

    def share(self, progress: float) -> float:
        return share_of_rate(progress, self.schedule, self.hold, self.warmup)
