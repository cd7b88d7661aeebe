"""Announce once that Numba compiles: the first run on a machine waits for it, later runs load the stored code."""

import logging
from functools import cache
from typing import Any

from brushexp.compat.kept_kernels import is_kept

log = logging.getLogger(__name__)


@cache
def tell_of_compilation() -> None:
    """Log the first compilation of this process when it begins; loading stored code logs nothing."""
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
