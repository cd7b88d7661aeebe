"""Where the classes of optimisers come from."""

import importlib
import inspect
from collections.abc import Callable
from enum import Enum
from typing import Any

from torch import optim

from brushexp.errors import UserError


class Library(Enum):
    """Who made an optimiser, and the module that has it."""

    torch = "torch.optim"
    pytorch_optimizer = "pytorch_optimizer"


class Lbfgs(optim.LBFGS):
    """That of PyTorch, which holds on to its first parameters, for strokes that come and go."""

    def step(self, closure: Any = None) -> Any:
        self._params = self.param_groups[0]["params"]
        self._numel_cache = None
        return super().step(closure)


def class_of(library: Library, name: str, options: dict[str, Any]) -> Callable[..., optim.Optimizer]:
    """The class ``name`` of a library, which takes these options.

    Raises:
        UserError: if the library is not installed, or has no such class, or would drop an option without a word.
    """
    try:
        module = importlib.import_module(library.value)
    except ImportError as error:
        raise UserError(
            "this optimizer needs the library pytorch-optimizer; pip install 'brushexp[optimizers]'"
        ) from error
    kinds = {
        key: value
        for key, value in vars(module).items()
        if isinstance(value, type) and issubclass(value, optim.Optimizer) and value is not optim.Optimizer
    }
    if name not in kinds:
        raise UserError(
            f"{library.value} has no optimiser {name!r}; set optimizer.name to one of {', '.join(sorted(kinds))}"
        )
    kind = kinds[name]
    if library is Library.pytorch_optimizer:  # it drops what it does not know
        known = inspect.signature(kind).parameters
        for key in options:
            if key not in known or key == "lr":
                choices = ", ".join(k for k in known if k not in ("params", "lr", "kwargs"))
                raise UserError(f"optimizer.options has {key!r}, which {name} does not take; it takes {choices}")
    return Lbfgs if kind is optim.LBFGS else kind
