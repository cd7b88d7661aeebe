"""Trace the outlines of the visible parts of strokes."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]

TOLERANCE = 0.45  # tolerance in pixels when outlines are simplified


def outlines_of(labels: Array, count: int) -> list[Array]:
    """Trace the outline of the largest part of each of ``count`` regions (H, W) as points x, y (P, 2).

    The outline of an empty region has no points.
    """
    from scipy.ndimage import find_objects  # noqa: PLC0415  (slow to import)
    from skimage.measure import approximate_polygon, find_contours  # noqa: PLC0415

    outlines = []
    for number, box in enumerate(find_objects(labels + 1, max_label=count)):
        if box is None:
            outlines.append(np.empty((0, 2)))
            continue
        rows, columns = box
        mask = np.pad(labels[box] == number, 1).astype(float)
        longest = max(find_contours(mask, 0.5), key=len)
        corner = np.array([columns.start, rows.start]) - 0.5  # pixel centre, minus the padding
        outlines.append(approximate_polygon(longest, TOLERANCE)[:, ::-1] + corner)
    return outlines
