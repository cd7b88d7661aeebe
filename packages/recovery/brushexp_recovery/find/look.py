"""Look at part of a picture once: merge its superpixels into a tree, and choose the nodes that are strokes."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from brushexp_recovery.join.merge_tree import MergeTree, grow_tree
from brushexp_recovery.join.node_features import node_features
from brushexp_recovery.join.tree_cut import best_cut
from brushexp_recovery.model.features import NodeScore
from brushexp_recovery.model.recovery_model import Classifiers
from brushexp_recovery.raster.resampling import nearest_pixels
from brushexp_recovery.segment.affinity_maps import StrokeMaps
from brushexp_recovery.segment.moments import Moment
from brushexp_recovery.segment.superpixels import Superpixels, superpixels_of

Array = NDArray[Any]

SMALLEST_REGION = 12  # pixels; smaller regions are no strokes
PAINTED = 0.5  # share of paint below which a region counts as ground
MATCH_WEIGHT = 0.85  # weight of the probability of a match in a node's worth; the rest is the expected IoU
NODE_PRICE = 0.42  # worth above which a node is chosen


@dataclass(frozen=True)
class Look:
    """The result of one look at part of a picture: its superpixels, their merge tree and the chosen regions."""

    superpixels: Array  # (h, w) int32, the leaf of the tree at each pixel of the part
    tree: MergeTree
    worth: Array  # (nodes,) mean of match probability and expected IoU; 0 for nodes that are no strokes
    nodes: Array  # (N,) nodes of the best cut
    regions: Array  # (h, w) int32, the index in ``nodes`` at each pixel; -1 for none

    def pixels_for(self, size: tuple[int, ...]) -> tuple[Array, ...]:
        """Return the row and column indices that resample this look to another picture size (H, W)."""
        return np.ix_(*(nearest_pixels(side, own) for side, own in zip(size, self.superpixels.shape, strict=True)))


def look_at(maps: StrokeMaps, image: Array, classifiers: Classifiers) -> Look:
    """Split a picture (h, w, 3) into superpixels, merge them, and choose the nodes that are strokes."""
    return join_superpixels(superpixels_of(maps, image), classifiers)


def join_superpixels(superpixels: Superpixels, classifiers: Classifiers) -> Look:
    """Merge superpixels into a tree, and choose the nodes that are strokes."""
    tree = grow_tree(superpixels, classifiers.pairs)
    score = classifiers.nodes(node_features(tree))
    area, paint = tree.moments[:, Moment.AREA], tree.moments[:, Moment.PAINT]
    no_stroke = (paint < PAINTED * area) | (area < SMALLEST_REGION)
    gain = MATCH_WEIGHT * score[:, NodeScore.MATCH] + (1 - MATCH_WEIGHT) * score[:, NodeScore.IOU] - NODE_PRICE
    cut = best_cut(tree, np.where(no_stroke, -1.0, gain))
    nodes, place = np.unique(np.append(-1, cut), return_inverse=True)
    regions = (place[1:] - 1).astype(np.int32)[superpixels.labels]
    return Look(superpixels.labels, tree, np.where(no_stroke, 0, score.mean(1)), nodes[1:], regions)
