"""Setup shared by the processes in `program`, imported before they are forked.

Garbage collection is off because the imported modules are never garbage, and searching them takes time. A first
compilation makes Numba fill its tables, which the forks then share.
"""

import gc

gc.disable()
import numba  # noqa: E402

numba.njit(lambda x: x)(1.0)
