"""Resample pictures to another scale."""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

Array = NDArray[Any]


def resample(image: Array, zoom: float) -> Array:
    """Enlarge a picture (H, W, 3) float32 in [0, 1] by bicubic interpolation, or reduce it with a Lanczos filter."""
    if zoom == 1:
        return image
    height, width = (max(1, round(zoom * size)) for size in image.shape[:2])
    method = Image.Resampling.BICUBIC if zoom > 1 else Image.Resampling.LANCZOS
    channels = [Image.fromarray(image[..., channel]).resize((width, height), method) for channel in range(3)]
    return np.clip(np.stack([np.asarray(channel) for channel in channels], 2), 0, 1)


def nearest_pixels(size: int, other_size: int) -> Array:
    """Map each of the ``size`` pixels of an axis to the nearest of the ``other_size`` pixels after resampling."""
    return ((np.arange(size) + 0.5) * other_size / size).astype(int).clip(0, other_size - 1)
