"""Shared setup of the processes in `program`, imported before they are forked.

Modules are never garbage, so garbage collection is off; Numba fills its tables.
"""

import gc

gc.disable()
import numba  # noqa: E402

numba.njit(lambda x: x)(1.0)
