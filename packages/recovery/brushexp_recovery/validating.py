"""While the network learns, regions joined by its affinities alone are compared with the known strokes."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from brushexp_recovery.looking import LEAST
from brushexp_recovery.maps import Maps
from brushexp_recovery.network import AFFINE, GEOMETRY
from brushexp_recovery.raster.labels import count_pixels
from brushexp_recovery.raster.overlap import overlaps_between
from brushexp_recovery.regions import pieces_of
from brushexp_recovery.score import HIT
from brushexp_recovery.synthesis_crops import Crops
from brushexp_recovery.tree import cut, grow

Array = NDArray[Any]

TOGETHER = 0.5  # mean affinity down to which regions are joined


class Counts(NamedTuple):
    """Numbers of strokes."""

    hits: int  # found ones that overlap a known one with an IoU of `HIT` or more
    found: int
    known: int

    @property
    def f1(self) -> float:
        return 2 * self.hits / max(self.found + self.known, 1)


def counts_of(told: Tensor, crops: Crops) -> Counts:
    """Count the strokes that maps (B, `CHANNELS`, H, W) find in crops, by joining regions of high mean affinity."""
    each = [
        _counts(maps, image, labels)
        for maps, image, labels in zip(
            told.numpy(), crops.image.numpy().transpose(0, 2, 3, 1), crops.labels.numpy(), strict=True
        )
    ]
    return Counts(*(sum(column) for column in zip(*each, strict=True)))


def _counts(told: Array, image: Array, labels: Array) -> Counts:
    affinity = 1 / (1 + np.exp(-told[:AFFINE]))
    pieces = pieces_of(Maps(affinity, told[AFFINE : AFFINE + GEOMETRY], told[AFFINE + GEOMETRY :]), image)
    tree = grow(pieces, None, TOGETHER)
    area, paint = tree.sums[:, 0], tree.sums[:, 20]
    regions = cut(tree, np.where(paint < 0.5 * area, -1.0, area**2))[pieces.labels]  # squares: the largest nodes
    _, _, iou = overlaps_between(labels, regions, int(labels.max()) + 1, len(area))
    found, known = (count_pixels(numbers, 1) for numbers in (regions, labels))
    return Counts(int((iou >= HIT).sum()), int((found >= LEAST).sum()), int((known >= LEAST).sum()))
