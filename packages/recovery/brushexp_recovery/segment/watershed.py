"""Find the borders between strokes, and the basins that these borders enclose."""

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from brushexp_recovery.model.channels import AFFINITY_OFFSETS
from brushexp_recovery.raster.blur import gaussian_blur
from brushexp_recovery.raster.offsets import shift

Array = NDArray[Any]

ADJACENT_OFFSETS = 2  # number of the first `AFFINITY_OFFSETS`, which have a length of 1 pixel
BORDER_OFFSETS = 6  # number of the first offsets, of 1 and 3 pixels, from which borders are computed
FAR_WEIGHT = 0.35  # weight of offsets of 3 pixels; adjacent pixels have weight 1
BORDER_BLUR = 0.6  # standard deviation in pixels of the blur of borders


def border_strength(affinity: Array) -> Array:
    """Compute the border strength (H, W), 0 to 1: one minus each pixel's weighted mean affinity to its neighbours."""
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
    """Flood basins from local minima of the border strength (H, W); return int32 labels (H, W) that start at 0.

    The basins are found by a watershed of the slightly blurred border strength.
    """
    from scipy.ndimage import label, minimum_filter  # noqa: PLC0415
    from skimage.segmentation import watershed  # noqa: PLC0415

    borders = gaussian_blur(borders, BORDER_BLUR)
    seeds, _ = label(borders == minimum_filter(borders, 3), np.ones((3, 3)))
    return np.asarray(watershed(borders, seeds), np.int32) - 1
