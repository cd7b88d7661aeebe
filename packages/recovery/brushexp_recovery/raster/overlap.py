"""Compute the intersection over union between regions of two label images."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from brushexp_recovery.raster.labels import count_pixels

Array = NDArray[Any]

MATCH_IOU = 0.5  # minimum intersection over union of two regions that show the same stroke


class Overlaps(NamedTuple):
    """Pairs of regions, one from each of two label images, that share pixels."""

    first: Array  # (P,) regions of the first image
    second: Array  # (P,) regions of the second image
    iou: Array  # (P,) intersection over union


def overlaps_between(first: Array, second: Array, first_count: int, second_count: int) -> Overlaps:
    """Find the pairs of overlapping regions in two label images (H, W), with their intersection over union."""
    both = (first >= 0) & (second >= 0)
    base = max(second_count, 1)
    pair, shared = np.unique(first[both].astype(np.int64) * base + second[both], return_counts=True)
    rows, columns = pair // base, pair % base
    union = count_pixels(first, first_count)[rows] + count_pixels(second, second_count)[columns] - shared
    return Overlaps(rows, columns, shared / union)


def pair_best(overlaps: Overlaps, least_iou: float) -> Overlaps:
    """Pair regions one to one, best pairs first, as long as their intersection over union is at least ``least_iou``."""
    with_partner: tuple[set[int], set[int]] = (set(), set())
    pairs = []
    for one, other, iou in sorted(zip(*overlaps, strict=True), key=lambda pair: -pair[2]):
        if iou >= least_iou and one not in with_partner[0] and other not in with_partner[1]:
            with_partner[0].add(one)
            with_partner[1].add(other)
            pairs.append((one, other, iou))
    first, second, ious = np.array(pairs).reshape(-1, 3).T
    return Overlaps(first.astype(int), second.astype(int), ious)
