"""Import Lightning and use torch's optimizers without importing torch's compiler, whose import takes long.

Strokes and renderers are not compiled by torch. Lightning needs the compiler's module only to recognise compiled
modules, and torch wraps its optimizers' methods in functions that import the compiler. `torch.compile` still loads the
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
    """Metaclass that makes `isinstance` check against the compiler's `OptimizedModule`, once the compiler is loaded."""

    def __instancecheck__(cls, instance: object) -> bool:
        compiler = sys.modules.get(COMPILER)
        return compiler is not None and isinstance(instance, compiler.OptimizedModule)


class OptimizedModule(metaclass=_IsCompiled):
    """Stand-in for the class of compiled modules, for use in `isinstance`."""


class _StandIn(ModuleType):
    """Stand-in for the compiler's module; access to any attribute that it lacks loads the compiler."""

    OptimizedModule = OptimizedModule

    @staticmethod
    def disable(function: Callable[..., Any], recursive: bool = True, **_: object) -> Callable[..., Any]:
        """Prevent the compilation of a function, by means of the compiler's `disable` once the compiler is loaded."""

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
    """Within the ``with`` block, give imported modules a stand-in for the compiler, so that they do not load it."""
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
    """Derive from a torch optimizer a class whose methods do not load the compiler."""
    methods = {name: inspect.unwrap(getattr(kind, name)) for name in METHODS}
    return type(kind.__name__, (kind,), {**methods, "step": torch.no_grad()(inspect.unwrap(kind.step))})
