"""Simulate JPEG compression of pictures."""

import io
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

Array = NDArray[Any]


def compress_as_jpeg(image: Array, quality: int) -> Array:
    """Compress a picture (H, W, 3) in [0, 1] as JPEG, and decode it to float32."""
    file = io.BytesIO()
    Image.fromarray((255 * image).round().astype(np.uint8)).save(file, "JPEG", quality=quality)
    with Image.open(file) as again:
        return np.asarray(again, np.float32) / 255
