"""Blur pictures and maps with a Gaussian."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]


def gaussian_blur(values: Array, sigma: float | Sequence[float]) -> Array:
    """Blur an array with a Gaussian; ``sigma``, in pixels, is either one number or one number per axis.

    The result has the data type of ``values``.
    """
    from scipy.ndimage import gaussian_filter  # noqa: PLC0415  (runs hide SciPy while Lightning is imported)

    return np.asarray(gaussian_filter(values, sigma))
