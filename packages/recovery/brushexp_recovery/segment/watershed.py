"""Borders between strokes, and the basins between them."""

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from brushexp_recovery.model.channels import AFFINITY_OFFSETS
from brushexp_recovery.raster.blur import gaussian_blur
from brushexp_recovery.raster.offsets import shift

Array = NDArray[Any]

ADJACENT_OFFSETS = 2  # of the `AFFINITY_OFFSETS` are of 1 pixel, the first ones
BORDER_OFFSETS = 6  # the first ones, of 1 and 3 pixels, say where borders are
FAR_WEIGHT = 0.35  # weight of an offset of 3 pixels; that of an adjacent pixel is 1
BORDER_BLUR = 0.6  # pixels: sigma by which borders are blurred


def border_strength(affinity: Array) -> Array:
    """Compute how strong a border (H, W) goes through each pixel, 0 to 1: the mean lack of affinity on both sides."""
    total, weights = np.zeros(affinity.shape[1:], np.float32), 0.0
    for channel, (dy, dx) in enumerate(AFFINITY_OFFSETS[:BORDER_OFFSETS]):
        weight = 1.0 if channel < ADJACENT_OFFSETS else FAR_WEIGHT
        apart = torch.from_numpy(1 - affinity[channel])
        apart[apart.shape[0] - dy :] = 0
        if dx:
            apart[:, slice(apart.shape[1] - dx, None) if dx > 0 else slice(0, -dx)] = 0
        total += weight * (apart + shift(apart, -dy, -dx)).numpy()
        weights += 2 * weight
    return total / weights


def flood_basins(borders: Array) -> Array:
    """Flood the basins between borders (H, W) from their local minima, by watershed: labels (H, W) int32 from 0."""
    from scipy.ndimage import label, minimum_filter  # noqa: PLC0415
    from skimage.segmentation import watershed  # noqa: PLC0415

    borders = gaussian_blur(borders, BORDER_BLUR)
    seeds, _ = label(borders == minimum_filter(borders, 3), np.ones((3, 3)))
    return np.asarray(watershed(borders, seeds), np.int32) - 1
