"""Measure the width of strokes on a plain ground from their shapes alone."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from brushexp_recovery.raster.resampling import resample

Array = NDArray[Any]

SIDE = 1000  # longer side, in pixels, to which larger pictures are reduced
BLUR = 1.0  # standard deviation in pixels of the blur that removes grain
CELL = 6.0  # CIELAB: side of the cells in which colours are counted
GROUND_DISTANCE = 8.0  # CIELAB: largest distance of a ground colour from the ground's median
LEAST_GROUND = 0.6  # smallest share of a picture that its ground covers
HAIR_HALF_WIDTH = 1.5  # pixels: half width up to which a line is too thin to count as a stroke
FEWEST_POINTS = 5  # smallest number of points on the centre lines of strokes


def width_on_plain_ground(image: Array) -> float | None:
    """Measure the median width in pixels of strokes on a plain ground in a picture (H, W, 3).

    The ground is the most frequent colour. A stroke's width is twice the distance between its centre line (a skeleton)
    and the ground; points on the centre lines are weighted by their width. Returns None if the ground covers less than
    60 % of the picture, or all of it, or if the strokes are too thin or too few. Overlapping strokes are measured as a
    single shape.
    """
    from scipy.ndimage import distance_transform_edt, gaussian_filter  # noqa: PLC0415  (slow to import)
    from skimage.color import rgb2lab  # noqa: PLC0415
    from skimage.morphology import skeletonize  # noqa: PLC0415

    reduction = min(1.0, SIDE / max(image.shape[:2]))
    lab = gaussian_filter(rgb2lab(resample(image, reduction)), (BLUR, BLUR, 0))
    cells, counts = np.unique((lab / CELL).round().reshape(-1, 3), axis=0, return_counts=True)
    is_near = np.linalg.norm(lab - CELL * cells[counts.argmax()], axis=2) < 1.5 * CELL
    is_bare = np.linalg.norm(lab - np.median(lab[is_near], axis=0), axis=2) < GROUND_DISTANCE
    if is_bare.mean() < LEAST_GROUND or is_bare.all():
        return None
    half = distance_transform_edt(~is_bare)
    half = np.sort(half[skeletonize(~is_bare) & (half > HAIR_HALF_WIDTH)])
    if len(half) < FEWEST_POINTS:
        return None
    total = half.cumsum()
    return float(2 * half[np.searchsorted(total, 0.5 * total[-1])] / reduction)
