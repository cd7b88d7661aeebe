"""How kernels are compiled: one set of rules for all. Import it only where kernels are, for Numba is slow to import."""

from numba import njit

# Rewriting allowed to the compiler: everything that keeps NaN and infinity what they are.
MATHS = {"contract", "reassoc", "nsz", "arcp"}
# Division as in numpy: a check for zero in a loop would keep it from becoming SIMD code.
inline = njit(cache=True, error_model="numpy", fastmath=MATHS, inline="always")
function = njit(cache=True, error_model="numpy", fastmath=MATHS, nogil=True)
kernel = njit(cache=True, error_model="numpy", fastmath=MATHS, parallel=True, nogil=True)
