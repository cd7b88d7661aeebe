"""Compile functions with Numba on their first call, so that only programs that need Numba spend a second importing it.

A compiled function can have **parts**: functions that it calls by name and that `Compiled.with_parts` can replace, so
one loop can serve many formulas. Numba infers the types of each part once for all of its callers. Machine code is
stored under a hash of the function and everything it calls, so changing any of that code triggers recompilation. An
`IntEnum` can name the columns of an array; its members are compiled as integers.

Compiled code runs on one thread and releases the GIL. A loop over independent iterations takes its start and end
indices as arguments, and `system.runtime.share` distributes it over threads. Numba's own parallel loops take three
times as long to compile because Numba optimises them twice, and their threads do not survive a fork.

The compiler assumes that an array written by a function does not overlap the function's other arrays.
"""

from collections import namedtuple
from collections.abc import Iterator, Mapping
from enum import IntEnum
from functools import cache, cached_property
from hashlib import sha256
from types import CodeType, FunctionType
from typing import Any

import numpy as np

from brushexp.compat.kept_kernels import keep_compiled


def first_of(values: Any, n: int) -> tuple[Any, ...]:
    """Return the first ``n`` numbers of an array as a tuple, which stays in registers; ``n`` must be a constant."""
    return tuple(values[:n])


# The compiler may reorder arithmetic, except for NaN and infinity. Checks for division by zero would prevent SIMD code.
OPTIONS: dict[str, Any] = {"nogil": True, "error_model": "numpy", "fastmath": {"contract", "reassoc", "nsz", "arcp"}}
_inlined: dict[str, Any] = {}  # Numba's versions of functions marked by `inline`, by the digest of their code


class Compiled:
    """A Python function that is compiled for its argument types when it is first called.

    The function can call other compiled functions and functions marked with `inline`. ``parts`` maps the names of
    called functions to replacements.
    """

    def __init__(self, function: FunctionType, parts: Mapping[str, Any]) -> None:
        self.function, self.parts = function, parts
        self.__doc__ = function.__doc__

    def __call__(self, *args: Any) -> Any:
        return self.dispatcher(*args)

    def with_parts(self, **parts: Any) -> "Compiled":
        """Return a copy of the function that calls ``parts`` in place of the functions with the same names."""
        return Compiled(self.function, {**self.parts, **parts})

    @cached_property
    def dispatcher(self) -> Any:
        import numba  # noqa: PLC0415  (it takes a second)

        function, digest = self._link(self.function)
        function.__qualname__ = f"{self.function.__qualname__}_{digest[:16]}"  # name of the file of machine code
        compiled = numba.njit(pipeline_class=_compiler(), **OPTIONS)(function)
        keep_compiled(compiled)
        return compiled

    def _link(self, function: FunctionType) -> tuple[FunctionType, str]:
        """Return a copy of a function that calls Numba versions of its callees, with a digest of all the code used."""
        import numba  # noqa: PLC0415

        scope, code, callees = dict(function.__globals__), function.__code__, []
        for name in sorted(set(_names(code)) & (scope.keys() | self.parts.keys())):
            value = self.parts.get(name, scope.get(name))
            if isinstance(value, type) and issubclass(value, IntEnum):
                value = _numbers_of(value)
            if isinstance(value, FunctionType) and getattr(value, "is_inline", False):
                linked, digest = self._link(value)
                value = _inlined.setdefault(
                    digest, numba.njit(forceinline=True, pipeline_class=_compiler(), **OPTIONS)(linked)
                )
                callees.append(digest)
            elif isinstance(value, Compiled):
                value = value.dispatcher
                callees.append(value.py_func.__qualname__)
            elif value is first_of:
                value = _first_of()
            elif isinstance(value, int | float | str | tuple | np.generic | np.ndarray):
                callees.append(f"{name}={value!r}")
            scope[name] = value
        copy = FunctionType(code, scope, function.__name__, function.__defaults__)
        copy.__module__, copy.__qualname__ = function.__module__, function.__qualname__
        return copy, sha256(repr((*_parts(code), callees)).encode()).hexdigest()


def _numbers_of(columns: type[IntEnum]) -> tuple[int, ...]:
    """Convert an enumeration to a named tuple of integers, because Numba before 0.62 cannot index with enum members."""
    names = [column.name for column in columns]
    tuple_of: Any = namedtuple(columns.__name__, names)  # type: ignore[misc]
    numbers: tuple[int, ...] = tuple_of(*map(int, columns))
    return numbers


@cache
def _compiler() -> Any:
    """Return a Numba compiler that assumes a function's arrays do not overlap; tested with Numba 0.68."""
    from numba.core.compiler import Compiler  # noqa: PLC0415

    class Apart(Compiler):
        def define_pipelines(self) -> Any:
            self.state.flags.noalias = True
            return super().define_pipelines()

    return Apart


@cache
def _first_of() -> Any:
    """Return Numba's implementation of `first_of`; Numba's own `to_fixed_tuple` copies each number through memory."""
    import operator  # noqa: PLC0415

    from numba import types  # noqa: PLC0415
    from numba.core.typing.templates import signature  # noqa: PLC0415
    from numba.extending import intrinsic  # noqa: PLC0415

    @intrinsic(prefer_literal=True)
    def first_of(typing_context: Any, values: Any, n: Any) -> Any:
        result = types.UniTuple(values.dtype, n.literal_value)

        def build(context: Any, builder: Any, _: Any, args: Any) -> Any:
            take = context.get_function(operator.getitem, signature(values.dtype, values, types.intp))
            places = [context.get_constant(types.intp, k) for k in range(n.literal_value)]
            return context.make_tuple(builder, result, [take(builder, (args[0], place)) for place in places])

        return result(values, n), build

    return first_of


def _names(code: CodeType) -> Iterator[str]:
    """Yield the names of the globals and attributes used in a function and its nested functions."""
    yield from code.co_names
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _names(constant)


def _parts(code: CodeType) -> tuple[Any, ...]:
    """List a code object's components without memory addresses, so that the list is the same in every process."""
    constants = [str(_parts(one)) if isinstance(one, CodeType) else repr(one) for one in code.co_consts]
    return code.co_code, code.co_names, code.co_varnames, constants


def inline(function: Any) -> Any:
    """Mark a function to be inlined into the compiled functions that call it."""
    function.is_inline = True
    return function


def function(function: Any) -> Compiled:
    """Decorate a function so that it is compiled on its first call."""
    return Compiled(function, {})
