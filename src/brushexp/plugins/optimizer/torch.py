"""Use any optimiser from torch.optim or from the library pytorch-optimizer."""

import importlib
import inspect
import math
from collections.abc import Callable, Iterable
from typing import Annotated, Any

import torch
from torch import nn, optim

from brushexp.bounds import above, between, one_of
from brushexp.compat.deferred_compiler import without_compiler
from brushexp.errors import UserError
from brushexp.plugins.optimizer.base import Optimizer
from brushexp.registry import register

# The thesis's learning rate of 0.01 moves a control point by a hundredth of a half-window per step of Adam.
UNITS = {"position": 1.0, "start": 1.0, "control": 1.0, "end": 1.0, "width": 0.3, "color": 1.0, "opacity": 1.0}
UNITS |= {"softness": 0.0, "widening": 0.0, "drift": 0.0}
LIBRARIES = {"torch": "torch.optim", "pytorch_optimizer": "pytorch_optimizer"}  # name -> module


@register("optimizer", "torch")
class TorchOptim(Optimizer):
    """Any optimiser of torch.optim, with a unit for each field and a schedule; presets exist for common classes.

    AdaHessian and SophiaH need second derivatives, which the compiled blend does not provide. A field of N strokes is a
    tensor (N, 2), (N, 3) or (N,); for classes that keep a matrix per dimension, set ``options`` so that they exclude
    the dimension N.

    Args:
        name: name of a class in ``library``, such as Adam, NAdam or Adagrad.
        library: library that contains the class: torch, or pytorch_optimizer (an extra) with SOAP, Kron, Adan and a
            hundred more.
        lr: learning rate; ``units`` scales it for each field.
        units: unit of each field. For Adam, ``lr`` times the unit is about the size of a step, in half-windows for the
            position and the points, and in fractions of the window for width and softness. A unit of 0 freezes a field.
        schedule: course of the learning rate after ``hold``: constant, linear (to 0) or cosine (to 0).
        hold: fraction of the steps after which the learning rate begins to fall; at 1 it never falls.
        warmup: fraction of the steps over which the learning rate first rises from 0.
        options: further arguments for the class, such as ``{betas: [0.9, 0.99]}``.
    """

    def __init__(
        self,
        *,
        name: str = "Adam",
        library: Annotated[str, one_of(*LIBRARIES)] = "torch",
        lr: Annotated[float, above(0)] = 0.02,
        units: dict[str, float] = UNITS,
        schedule: Annotated[str, one_of("constant", "linear", "cosine")] = "linear",
        hold: Annotated[float, between(0, 1)] = 0.5,
        warmup: Annotated[float, between(0, 1)] = 0.0,
        options: dict[str, Any] = {},  # noqa: B006
    ) -> None:
        self.kind = class_of(library, name, options)
        self.name, self.library, self.options = name, library, options
        self.lr, self.units = lr, units
        self.schedule, self.hold, self.warmup = schedule, hold, warmup
        self.over([nn.Parameter(torch.zeros(1))])  # refuses options that the class does not accept

    def over(self, parameters: Iterable[nn.Parameter]) -> optim.Optimizer:
        try:
            optimizer = self.kind(parameters, lr=self.lr, **self.options)
        except (TypeError, ValueError) as error:
            cure = f"optimizer=torch optimizer.name={self.name} starts without options"
            raise UserError(f"{error} (optimizer.options={self.options}); {cure}") from error
        if self.library == "pytorch_optimizer":
            for group in optimizer.param_groups:
                group.setdefault("step", 0)  # the library's step count, which is missing before the first step
        return optimizer

    def share(self, progress: float) -> float:
        rise = min(1.0, (progress + 1e-9) / self.warmup) if self.warmup else 1.0
        falling = max(0.0, (progress - self.hold) / (1 - self.hold)) if self.hold < 1 else 0.0
        fall = {"constant": 1.0, "linear": 1 - falling, "cosine": 0.5 * (1 + math.cos(math.pi * falling))}
        return rise * fall[self.schedule]


class Lbfgs(optim.LBFGS):
    """PyTorch's L-BFGS, adapted to changing parameters and to gradients that are views."""

    def step(self, closure: Any = None) -> Any:
        self._params = self.param_groups[0]["params"]
        self._numel_cache = None

        def contiguous() -> Any:
            loss = closure()
            for parameter in self._params:
                if parameter.grad is not None:
                    parameter.grad = parameter.grad.contiguous()
            return loss

        return super().step(contiguous)


def class_of(library: str, name: str, options: dict[str, Any]) -> Callable[..., optim.Optimizer]:
    """Find a class by name in a library; raise a UserError if it would silently ignore one of the options."""
    try:
        module = vars(importlib.import_module(LIBRARIES[library]))
    except ImportError as error:
        cure = "pip install 'brushexp[optimizers]'"
        raise UserError(f"this optimizer needs the library pytorch-optimizer; {cure}") from error
    kinds = {key: kind for key, kind in module.items() if isinstance(kind, type) and issubclass(kind, optim.Optimizer)}
    kinds.pop("Optimizer", None)  # the base class
    if name not in kinds:
        choices = ", ".join(sorted(kinds))
        raise UserError(f"{LIBRARIES[library]} has no optimiser {name!r}; choose optimizer.name from {choices}")
    kind = kinds[name]
    if library == "pytorch_optimizer":  # the library ignores unknown options
        parameters = [key for key in inspect.signature(kind).parameters if key not in ("params", "lr", "kwargs")]
        unknown = [key for key in options if key not in parameters]
        if unknown:
            choices = ", ".join(parameters)
            raise UserError(f"optimizer.options has {unknown[0]!r}, which {name} does not accept; it accepts {choices}")
        return kind
    return without_compiler(Lbfgs if kind is optim.LBFGS else kind)
