"""Keep what Numba has compiled, or go without: no folder, a full disk or a damaged file ends no run (Numba 0.68)."""

import logging
from contextlib import suppress
from functools import cache
from typing import Any

log = logging.getLogger(__name__)


_unkept: set[str] = set()  # functions that could not be stored


def keep_compiled(function: Any) -> None:
    """Let a compiled function, `numba.njit`'s, load and store its machine code where a folder can be found for that."""
    try:
        function._cache = _forgiving_cache()(function.py_func)
    except RuntimeError:  # Numba has found no folder
        _tell_of(function.py_func.__qualname__)


def is_kept() -> bool:
    """Tell whether all that was compiled so far could be stored."""
    return not _unkept


def _tell_of(name: str) -> None:
    """Log once that functions cannot be stored."""
    if not _unkept:
        log.warning(
            "what is compiled cannot be kept, so each run compiles anew; "
            "NUMBA_CACHE_DIR=FOLDER before the command names a folder for it"
        )
    _unkept.add(name)


@cache
def _forgiving_cache() -> Any:
    """Make Numba's cache of a function one that compiles again what it cannot load, and goes on if it cannot store."""
    from numba.core.caching import FunctionCache  # noqa: PLC0415  (a second)

    class ForgivingCache(FunctionCache):
        def load_overload(self, sig: Any, target_context: Any) -> Any:
            try:
                return super().load_overload(sig, target_context)
            except Exception:  # a damaged file raises nearly anything
                with suppress(OSError):
                    self.flush()
                return None

        def save_overload(self, sig: Any, data: Any) -> None:
            try:
                super().save_overload(sig, data)
            except OSError:  # a full disk, a quota
                _tell_of(self._py_func.__qualname__)

    return ForgivingCache
