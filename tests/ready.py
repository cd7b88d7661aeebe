"""Setup shared by the processes in `program`, imported before they are forked.

Garbage collection is off because modules are never garbage, and a first compilation makes Numba fill its tables.
"""

import gc

gc.disable()
import numba  # noqa: E402

numba.njit(lambda x: x)(1.0)
