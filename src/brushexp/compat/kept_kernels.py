"""Store Numba's machine code; tolerate a missing folder, a full disk and damaged files (tested with Numba 0.68)."""

import logging
from contextlib import suppress
from functools import cache
from typing import Any

log = logging.getLogger(__name__)


_unkept: set[str] = set()  # functions that could not be stored


def keep_compiled(function: Any) -> None:
    """Let a function compiled with `numba.njit` load and store its machine code, if there is a cache folder."""
    try:
        function._cache = _forgiving_cache()(function.py_func)
    except RuntimeError:  # Numba has found no folder
        _log_unstored(function.py_func.__qualname__)


def is_kept() -> bool:
    """Return whether every function compiled so far could be stored."""
    return not _unkept


def _log_unstored(name: str) -> None:
    """Record that a function could not be stored, and warn about the first such function."""
    if not _unkept:
        log.warning(
            "compiled code cannot be stored, so every run compiles again; "
            "to choose a folder for it, put NUMBA_CACHE_DIR=FOLDER before the command"
        )
    _unkept.add(name)


@cache
def _forgiving_cache() -> Any:
    """Return a Numba cache class that recompiles code it cannot load and tolerates failed writes."""
    from numba.core.caching import FunctionCache  # noqa: PLC0415  (a second)

    class ForgivingCache(FunctionCache):
        def load_overload(self, sig: Any, target_context: Any) -> Any:
            try:
                return super().load_overload(sig, target_context)
            except Exception:  # a damaged file may raise nearly any error
                with suppress(OSError):
                    self.flush()
                return None

        def save_overload(self, sig: Any, data: Any) -> None:
            try:
                super().save_overload(sig, data)
            except OSError:  # a full disk, a quota
                _log_unstored(self._py_func.__qualname__)

    return ForgivingCache
