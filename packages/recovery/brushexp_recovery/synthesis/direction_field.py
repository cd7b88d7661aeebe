"""Compute a direction field for the strokes that paint a picture, and the picture's level of detail."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from brushexp_recovery.raster.blur import gaussian_blur
from brushexp_recovery.synthesis.hand import Random

Array = NDArray[Any]

FEWEST_PATCHES, MOST_PATCHES = 3, 30  # range of the number of patches hatched in one direction each
PATCH_STEP = 4  # resolution of patches in pixels


def edge_directions(picture: Array, sigma: float) -> Array:
    """Compute the direction (H, W), in radians, along the edges of a picture; it varies smoothly where edges are weak.

    The direction is computed from the structure tensor, blurred by ``sigma`` pixels and, with a low weight, by four
    times ``sigma``.
    """
    gy, gx = np.gradient(gaussian_blur(picture, (1, 1, 0)), axis=(0, 1))
    products = ((a * b).sum(-1) for a, b in ((gx, gx), (gx, gy), (gy, gy)))
    xx, xy, yy = (gaussian_blur(value, sigma) + 0.3 * gaussian_blur(value, 4 * sigma) for value in products)
    return 0.5 * np.arctan2(-2 * xy, yy - xx)


def detail_of(picture: Array, pitch: float) -> Array:
    """Measure the level of detail (H, W) of a picture at a scale of about ``pitch`` pixels."""
    down, right = np.gradient(gaussian_blur(picture, (1.5, 1.5, 0)), axis=(0, 1))
    return gaussian_blur(np.sqrt((down**2 + right**2).sum(-1)), 0.5 * pitch)


def add_hatching(angles: Array, share: float, random: Random) -> Array:
    """Replace a direction field (H, W) with patches of uniform direction in about a fraction ``share`` of its area."""
    if share == 0:
        return angles
    height, width = angles.shape
    count = int(random.integers(FEWEST_PATCHES, MOST_PATCHES))
    centres = random.random((count, 2)) * [height, width]
    rows, columns = np.mgrid[:height:PATCH_STEP, :width:PATCH_STEP]
    patch = ((rows[..., None] - centres[:, 0]) ** 2 + (columns[..., None] - centres[:, 1]) ** 2).argmin(-1)
    patch = patch.repeat(PATCH_STEP, 0).repeat(PATCH_STEP, 1)[:height, :width]
    direction = np.pi * random.random(count)
    return np.where((random.random(count) < share)[patch], direction[patch], angles)
