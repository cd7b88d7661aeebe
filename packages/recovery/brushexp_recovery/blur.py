"""Pictures are blurred."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]


def blurred(values: Array, sigma: float | Sequence[float]) -> Array:
    """Blur an array with a Gaussian of ``sigma`` pixels, of all axes or of each; the precision stays."""
    from scipy.ndimage import gaussian_filter  # noqa: PLC0415  (runs hide SciPy while Lightning is imported)

    return np.asarray(gaussian_filter(values, sigma))
