"""Find the pixels of marks on a canvas, and compare two sets of possibly overlapping regions."""

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from brushexp_recovery.marks.marks_file import Mark
from brushexp_recovery.raster.overlap import Overlaps

Array = NDArray[Any]


def pixels_of_mark(mark: Mark, size: tuple[int, int]) -> Array:
    """List the flat indices (int64, ascending) of the pixels of a canvas (H, W) that a mark covers."""
    if mark.outlines:
        return _pixels_in(mark.outlines, size)
    height, width = size
    radius = 0.5 * mark.width
    reach = radius[:, None] + 1
    left, top = np.maximum(np.floor((mark.points - reach).min(0)).astype(int), 0)
    right, bottom = np.minimum(np.ceil((mark.points + reach).max(0)).astype(int), (width, height))
    if left >= right or top >= bottom:
        return np.empty(0, np.int64)
    y, x = np.mgrid[top:bottom, left:right] + 0.5
    mask = np.hypot(x - mark.points[0, 0], y - mark.points[0, 1]) <= radius[0]
    for (start, begin), (end, last) in pairwise(zip(mark.points, radius, strict=True)):
        way = end - start
        along = ((x - start[0]) * way[0] + (y - start[1]) * way[1]) / max(way @ way, 1e-9)
        along = along.clip(0, 1)
        distance = np.hypot(x - start[0] - along * way[0], y - start[1] - along * way[1])
        mask |= distance <= begin + along * (last - begin)
    rows, columns = np.nonzero(mask)
    flat: Array = (rows + top) * width + columns + left
    return flat


def _pixels_in(outlines: Sequence[Array], size: tuple[int, int]) -> Array:
    """List the flat indices of the pixels that are inside any of several outlines."""
    from skimage.draw import polygon  # noqa: PLC0415  (slow to import)

    parts = []
    for outline in outlines:
        rows, columns = polygon(outline[:, 1] - 0.5, outline[:, 0] - 0.5, size)
        parts.append(rows.astype(np.int64) * size[1] + columns)
    return np.unique(np.concatenate(parts))


def overlaps_of_pixels(first: Sequence[Array], second: Sequence[Array], pixels: int) -> Overlaps:
    """Find the pairs of overlapping regions, one from each list, on a canvas of ``pixels`` pixels, with their IoU.

    Unlike in `overlaps_between`, which compares label images, regions in the same list may overlap. Regions are given
    as flat indices.
    """
    from scipy.sparse import csr_matrix  # noqa: PLC0415  (slow to import)

    def as_rows(regions: Sequence[Array]) -> Any:
        ends = np.cumsum([0, *map(len, regions)])
        places = np.concatenate([np.empty(0, np.int64), *regions])
        return csr_matrix((np.ones(len(places)), places, ends), shape=(len(regions), pixels))

    shared = (as_rows(first) @ as_rows(second).T).tocoo()
    area, other_area = (np.array([len(region) for region in regions]) for regions in (first, second))
    rows, columns = shared.row.astype(int), shared.col.astype(int)
    return Overlaps(rows, columns, shared.data / (area[rows] + other_area[columns] - shared.data))
