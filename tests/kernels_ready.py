"""Imported where processes of the program are forked, see `program`: Numba fills its tables once, and not in each."""

import numba

numba.njit(lambda x: x)(1.0)
