"""Imported first where processes of the program are forked, see `program`: what would take time in each is done once.

Modules are no garbage, and are not searched for any; Numba fills its tables.
"""

import gc

gc.disable()
import numba  # noqa: E402

numba.njit(lambda x: x)(1.0)
