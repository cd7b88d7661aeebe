"""Validate the network during training: compare known strokes with regions that are merged by affinity alone."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from brushexp_recovery.find.look import PAINTED, SMALLEST_REGION
from brushexp_recovery.join.merge_tree import grow_tree
from brushexp_recovery.join.tree_cut import best_cut
from brushexp_recovery.model.channels import AFFINITY, ATTRIBUTES, OCCLUSION, PAINT
from brushexp_recovery.model.logistic import sigmoid
from brushexp_recovery.raster.labels import count_pixels
from brushexp_recovery.raster.overlap import MATCH_IOU, overlaps_between
from brushexp_recovery.segment.affinity_maps import StrokeMaps
from brushexp_recovery.segment.moments import Moment
from brushexp_recovery.segment.superpixels import superpixels_of
from brushexp_recovery.train.crops import Crops

Array = NDArray[Any]

LEAST_AFFINITY = 0.5  # mean affinity down to which regions are merged


class Counts(NamedTuple):
    """Numbers of matching, found and known strokes."""

    hits: int  # found strokes that overlap a known stroke with an IoU of at least `MATCH_IOU`
    found: int
    known: int

    @property
    def f1(self) -> float:
        """Harmonic mean of precision and recall."""
        return 2 * self.hits / max(self.found + self.known, 1)

    def plus(self, other: "Counts") -> "Counts":
        """Add the counts of other pictures to these counts."""
        return Counts(self.hits + other.hits, self.found + other.found, self.known + other.known)


def count_strokes(output: Tensor, crops: Crops) -> Counts:
    """Count the strokes found in crops when regions of high affinity in maps (B, `CHANNELS`, H, W) are merged."""
    total = Counts(0, 0, 0)
    images = crops.image.numpy().transpose(0, 2, 3, 1)
    for maps, image, labels in zip(output.numpy(), images, crops.labels.numpy(), strict=True):
        total = total.plus(_count_in(maps, image, labels))
    return total


def _count_in(channels: Array, image: Array, labels: Array) -> Counts:
    """Count the strokes that are found in a picture (H, W, 3), given its maps (`CHANNELS`, H, W)."""
    maps = StrokeMaps(sigmoid(channels[AFFINITY]), channels[PAINT], channels[ATTRIBUTES], channels[OCCLUSION])
    superpixels = superpixels_of(maps, image)
    tree = grow_tree(superpixels, None, LEAST_AFFINITY)
    area, paint = tree.moments[:, Moment.AREA], tree.moments[:, Moment.PAINT]
    value = np.where(paint < PAINTED * area, -1.0, area**2)  # squares favour the largest nodes
    regions = best_cut(tree, value)[superpixels.labels]
    iou = overlaps_between(labels, regions, int(labels.max()) + 1, len(area)).iou
    hits = int((iou >= MATCH_IOU).sum())
    found, known = (int((count_pixels(one, 1) >= SMALLEST_REGION).sum()) for one in (regions, labels))
    return Counts(hits, found, known)
