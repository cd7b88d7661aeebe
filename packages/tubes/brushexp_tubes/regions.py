"""Divide a plan into regions of one mixture, to paint by numbers."""

from collections.abc import Iterator

import numpy as np
import torch

from brushexp_tubes.plan import Plan

Array = np.ndarray
NUMBERED = 300  # pixels of the longer side of what is drawn to paint by numbers


def numbered_regions(plan: Plan) -> Array:
    """Number the mixture (h, w) from 0 that a picture shows at each place, without spots that no brush could paint."""
    from scipy.ndimage import distance_transform_edt, label  # noqa: PLC0415  (slow to import)

    small = plan.played().at_most(NUMBERED)
    colors = torch.from_numpy(small.picture()).double() / 255
    mixtures = plan.table.mixtures
    if not len(mixtures):
        return np.zeros(small.size, dtype=int)
    away = torch.cdist(colors.reshape(-1, 3), mixtures.color.double())
    regions = away.argmin(1).reshape(small.size).numpy()
    least = (float(plan.table.brushes.min()) * small.size[1] / plan.job.size[1]) ** 2
    spots = np.zeros(regions.shape, dtype=bool)
    for number in np.unique(regions):
        parts, _ = label(regions == number)
        spots |= (np.bincount(parts.ravel())[parts] < least) & (parts > 0)
    if spots.all():
        return regions
    nearest = distance_transform_edt(spots, return_distances=False, return_indices=True)
    return regions[tuple(nearest)]


def labels_of(mask: Array) -> Iterator[tuple[int, int, float]]:
    """Find a place (row, column) for a number in each part of a mask (h, w), and how far it is from the edge."""
    from scipy.ndimage import distance_transform_edt, label, maximum_position  # noqa: PLC0415  (slow to import)

    parts, count = label(mask)
    depth = distance_transform_edt(np.pad(mask, 1))[1:-1, 1:-1]
    for row, column in maximum_position(depth, parts, range(1, count + 1)):
        yield int(row), int(column), float(depth[int(row), int(column)])
