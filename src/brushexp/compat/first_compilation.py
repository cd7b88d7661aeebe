"""Log a message when Numba compiles, which delays the first run on a machine; later runs load the stored code."""

import logging
from functools import cache
from typing import Any

from brushexp.compat.kept_kernels import is_kept

log = logging.getLogger(__name__)


@cache
def log_compilation() -> None:
    """Log a message when this process first compiles a function; loading stored code logs nothing."""
    from numba.core import event  # noqa: PLC0415  (a second)

    class Teller(event.Listener):
        told = False

        def on_start(self, event: Any) -> None:
            if not self.told:
                log.info("compiling for this machine%s: about 20 s", " (first run only)" if is_kept() else "")
            self.told = True

        def on_end(self, event: Any) -> None:
            pass

    event.register("numba:compile", Teller())
