"""Numba compiles these functions at their first call, so that nothing else waits a second for Numba to be imported.

A kernel may have **parts**: functions that it calls by name and that are chosen for it (`Compiled.having`), so that one
loop serves many formulas. Machine code is kept on disk, under a name made from the code of the function and of
everything that it calls: a change in any file is noticed, and no two choices of parts are mixed up. Whoever compiles
stores first and then loads, so that all processes run the same instructions, and a resumed run has the same bits.

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
    """The first ``n`` numbers of an array as a tuple, which a kernel keeps in registers; ``n`` is a constant."""
    return tuple(values[:n])


# Rewriting allowed to the compiler: everything that keeps NaN and infinity what they are.
MATHS = {"contract", "reassoc", "nsz", "arcp"}
# Division as in numpy: a check for zero in a loop would keep it from becoming SIMD code.
OPTIONS: dict[str, Any] = {"error_model": "numpy", "fastmath": MATHS}


class Compiled:
    """A function that is compiled when it is called for the first time, for the types it is then called with.

    It is plain Python, may call functions marked by `inline` and other compiled ones, and ``parts`` take the place of
    those that it calls by their names. The ``options`` are of `numba.njit`.
    """

    def __init__(self, function: FunctionType, parts: Mapping[str, Any], **options: Any) -> None:
        self.function, self.parts, self.options = function, parts, options
        self.__doc__ = function.__doc__

    def __call__(self, *args: Any) -> Any:
        return self.dispatcher(*args)

    def having(self, **parts: Any) -> "Compiled":
        """The same function with these parts."""
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
        """A copy that calls Numba's versions of what it calls, and a digest of all the code in it."""
        import numba  # noqa: PLC0415
        from numba.np.unsafe.ndarray import to_fixed_tuple  # noqa: PLC0415

        scope, code, seen = dict(function.__globals__), function.__code__, []
        for name in sorted(set(_names(code)) & (scope.keys() | self.parts.keys())):
            value = self.parts.get(name, scope.get(name))
            if isinstance(value, FunctionType) and getattr(value, "is_inline", False):
                linked, digest = self._linked(value, inlined)
                value = inlined.setdefault(digest, numba.njit(inline="always", **OPTIONS)(linked))
                seen.append(digest)
            elif isinstance(value, Compiled):
                value = value.dispatcher
                seen.append(value.py_func.__qualname__)
            elif value is prange:
                value = numba.prange
            elif value is first_of:
                value = to_fixed_tuple
            elif isinstance(value, int | float | str | tuple | np.generic):
                seen.append(f"{name}={value!r}")
            scope[name] = value
        copy = FunctionType(code, scope, function.__name__, function.__defaults__)
        copy.__module__, copy.__qualname__ = function.__module__, function.__qualname__
        text = repr((code.co_code, code.co_names, code.co_varnames, list(map(repr, code.co_consts)), seen))
        return copy, sha256(text.encode()).hexdigest()


@contextmanager
def _own_engine(context: Any) -> Iterator[None]:
    """Let Numba put the machine code that it makes or loads where no other code is; its compiler lock is held."""
    engine = context._internal_codegen
    context._internal_codegen = type(engine)("brushexp")
    try:
        yield
    finally:
        context._internal_codegen = engine


def _stored(function: FunctionType, options: Mapping[str, Any]) -> Any:
    """Numba's store of a function's machine code, which compiles what it lacks.

    A parallel loop is optimised alone, and once more as a part of its function. Only the latter is stored, while the
    process that compiles would run the former, which was there first: its last bits are others.
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
    """Names of globals and attributes in a function and in those inside it."""
    yield from code.co_names
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _names(constant)


def inline(function: Any) -> Any:
    """Mark a function whose code is put where it is called; it has no life of its own."""
    function.is_inline = True
    return function


def function(function: Any) -> Compiled:
    """Compile a function that uses one thread."""
    return Compiled(function, {}, nogil=True, **OPTIONS)


def kernel(function: Any) -> Compiled:
    """Compile a function whose `prange` loops use all threads."""
    return Compiled(function, {}, nogil=True, parallel=True, **OPTIONS)
