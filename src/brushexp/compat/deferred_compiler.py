"""Use Lightning and torch's optimizers without importing torch's compiler, which is slow to import.

brushexp does not compile strokes or renderers with torch. Lightning imports the compiler only to recognise compiled
modules, and torch wraps the methods of its optimizers in functions that import it. `torch.compile` still loads the
compiler as usual.
"""

import functools
import inspect
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib import import_module
from types import ModuleType
from typing import Any

import torch
from torch import optim

COMPILER = "torch._dynamo"
METHODS = "add_param_group", "zero_grad", "state_dict", "load_state_dict"  # of an optimizer


class _IsCompiled(type):
    """A metaclass that makes `isinstance` check for the compiler's `OptimizedModule` once the compiler is loaded."""

    def __instancecheck__(cls, instance: object) -> bool:
        compiler = sys.modules.get(COMPILER)
        return compiler is not None and isinstance(instance, compiler.OptimizedModule)


class OptimizedModule(metaclass=_IsCompiled):
    """A stand-in for the class of compiled modules, used only in `isinstance` checks."""


class _StandIn(ModuleType):
    """A stand-in for the compiler's module that loads the compiler when any other attribute is read."""

    OptimizedModule = OptimizedModule

    @staticmethod
    def disable(function: Callable[..., Any], recursive: bool = True, **_: object) -> Callable[..., Any]:
        """Exempt a function from compilation by calling the compiler's own `disable` once the compiler is loaded."""

        @functools.wraps(function)
        def call(*arguments: Any, **options: Any) -> Any:
            compiler = sys.modules.get(COMPILER)
            run = compiler.disable(function, recursive) if compiler else function
            return run(*arguments, **options)

        return call

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        if sys.modules.get(COMPILER) is self:
            del sys.modules[COMPILER]
        return getattr(import_module(COMPILER), name)


@contextmanager
def defer_compiler() -> Iterator[None]:
    """Replace the compiler with a stand-in during the ``with`` block, so that imports do not load the compiler."""
    if COMPILER in sys.modules:
        yield
        return
    stand_in = sys.modules[COMPILER] = _StandIn(COMPILER)
    try:
        yield
    finally:
        if sys.modules.get(COMPILER) is stand_in:
            del sys.modules[COMPILER]


def without_compiler(kind: type[optim.Optimizer]) -> type[optim.Optimizer]:
    """Return a subclass of a torch optimizer whose methods do not load the compiler."""
    methods = {name: inspect.unwrap(getattr(kind, name)) for name in METHODS}
    return type(kind.__name__, (kind,), {**methods, "step": torch.no_grad()(inspect.unwrap(kind.step))})
