"""Compile functions with Numba at their first call, so that nothing else waits a second for its import.

A kernel may have **parts**: functions that it calls by name and that are chosen for it (`Compiled.having`), so that one
loop serves many formulas. Machine code is stored under a name made from the code of the function and of everything that
it calls, so a change in any file is noticed. It is stored first and then loaded, so that all processes run the same
instructions, and a resumed run has the same bits.

This replaces two private parts of Numba, its code generator and its function cache; it was tried with Numba 0.68.
"""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import cached_property
from hashlib import sha256
from types import CodeType, FunctionType
from typing import Any

import numpy as np

prange = range  # becomes that of Numba, which shares the loop among threads


def first_of(values: Any, n: int) -> tuple[Any, ...]:
    """Return the first ``n`` numbers of an array as a tuple, which stays in registers; ``n`` is a constant."""
    return tuple(values[:n])


# The compiler may rewrite all but NaN and infinity. A check for a division by zero would prevent SIMD code.
OPTIONS: dict[str, Any] = {"error_model": "numpy", "fastmath": {"contract", "reassoc", "nsz", "arcp"}}


class Compiled:
    """A Python function that is compiled at its first call, for the types of that call.

    It may call functions marked by `inline` and other compiled ones; ``parts`` replace those of their names. The
    ``options`` are of `numba.njit`.
    """

    def __init__(self, function: FunctionType, parts: Mapping[str, Any], **options: Any) -> None:
        self.function, self.parts, self.options = function, parts, options
        self.__doc__ = function.__doc__

    def __call__(self, *args: Any) -> Any:
        return self.dispatcher(*args)

    def having(self, **parts: Any) -> "Compiled":
        """Return the same function with these parts."""
        return Compiled(self.function, {**self.parts, **parts}, **self.options)

    @cached_property
    def dispatcher(self) -> Any:
        import numba  # noqa: PLC0415  (it takes a second)

        function, digest = self._linked(self.function, {})
        function.__qualname__ = f"{self.function.__qualname__}_{digest[:16]}"  # names the file of machine code
        dispatcher = numba.njit(cache=True, **self.options)(function)
        dispatcher._cache = _stored(function, self.options)
        return dispatcher

    def _linked(self, function: FunctionType, inlined: dict[str, Any]) -> tuple[FunctionType, str]:
        """Return a copy that calls Numba's versions of what it calls, and a digest of all code in it."""
        import numba  # noqa: PLC0415
        from numba.np.unsafe.ndarray import to_fixed_tuple  # noqa: PLC0415

        scope, code, callees = dict(function.__globals__), function.__code__, []
        for name in sorted(set(_names(code)) & (scope.keys() | self.parts.keys())):
            value = self.parts.get(name, scope.get(name))
            if isinstance(value, FunctionType) and getattr(value, "is_inline", False):
                linked, digest = self._linked(value, inlined)
                value = inlined.setdefault(digest, numba.njit(inline="always", **OPTIONS)(linked))
                callees.append(digest)
            elif isinstance(value, Compiled):
                value = value.dispatcher
                callees.append(value.py_func.__qualname__)
            elif value is prange:
                value = numba.prange
            elif value is first_of:
                value = to_fixed_tuple
            elif isinstance(value, int | float | str | tuple | np.generic):
                callees.append(f"{name}={value!r}")
            scope[name] = value
        copy = FunctionType(code, scope, function.__name__, function.__defaults__)
        copy.__module__, copy.__qualname__ = function.__module__, function.__qualname__
        text = repr((code.co_code, code.co_names, code.co_varnames, list(map(repr, code.co_consts)), callees))
        return copy, sha256(text.encode()).hexdigest()


@contextmanager
def _own_engine(context: Any) -> Iterator[None]:
    """Let Numba generate or load machine code apart from all other code; its compiler lock is held."""
    engine = context._internal_codegen
    context._internal_codegen = type(engine)("brushexp")
    try:
        yield
    finally:
        context._internal_codegen = engine


def _stored(function: FunctionType, options: Mapping[str, Any]) -> Any:
    """Make Numba's store of a function's machine code, which compiles what it lacks.

    A parallel loop is optimised alone, and again as a part of its function. Only the latter is stored, while the
    process that compiles would run the former, whose last bits differ.
    """
    import numba  # noqa: PLC0415
    from numba.core.caching import FunctionCache  # noqa: PLC0415

    class Stored(FunctionCache):
        def load_overload(self, sig: Any, target_context: Any) -> Any:
            with _own_engine(target_context):
                overload = super().load_overload(sig, target_context)
            if overload is None:
                with _own_engine(target_context):
                    numba.njit(cache=True, **options)(function).compile(sig)
                with _own_engine(target_context):
                    overload = super().load_overload(sig, target_context)
            return overload

    return Stored(function)


def _names(code: CodeType) -> Iterator[str]:
    """Yield names of globals and attributes in a function and in those inside it."""
    yield from code.co_names
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _names(constant)


def inline(function: Any) -> Any:
    """Mark a function whose code is put where it is called."""
    function.is_inline = True
    return function


def function(function: Any) -> Compiled:
    """Compile a function that uses one thread."""
    return Compiled(function, {}, nogil=True, **OPTIONS)


def kernel(function: Any) -> Compiled:
    """Compile a function whose `prange` loops use all threads."""
    return Compiled(function, {}, nogil=True, parallel=True, **OPTIONS)
