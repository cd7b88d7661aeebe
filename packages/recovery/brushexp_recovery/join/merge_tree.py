"""Grow a merge tree, whose leaves are superpixels and whose other nodes each merge two regions."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from brushexp_recovery.join.merge_loop import merge, merge_by_affinity
from brushexp_recovery.model.perceptron import PerceptronWeights
from brushexp_recovery.segment.region_adjacency import AffinityColumn
from brushexp_recovery.segment.superpixels import Superpixels

Array = NDArray[Any]

LEAST_CHANCE = 0.05  # probability of being one stroke below which two regions are never merged
NO_PERCEPTRON = PerceptronWeights(
    np.empty(0, np.float32), np.empty(0, np.float32), (np.empty((1, 1), np.float32),)
)  # placeholder that compiled code accepts instead of a perceptron


@dataclass(frozen=True)
class MergeTree:
    """A tree whose nodes 0 to S - 1 are superpixels, and whose nodes S to S + M - 1 each merge two earlier nodes.

    Arrays over nodes have S + M rows.
    """

    children: Array  # (M, 2) the two nodes that each merge combines
    moments: Array  # (nodes, len(Moment))
    within: Array  # (nodes, len(AffinityColumn)) affinities within the region
    around: Array  # (nodes, len(AffinityColumn)) affinities to other regions
    merge_chance: Array  # (nodes,) probability of the merge that formed a node; 1 for a superpixel
    neighbour_chance: Array  # (nodes,) highest probability of being one stroke with a neighbour

    @property
    def leaves(self) -> int:
        """Number of superpixels."""
        return len(self.moments) - len(self.children)


def grow_tree(
    superpixels: Superpixels, perceptron: PerceptronWeights | None, least_chance: float = LEAST_CHANCE
) -> MergeTree:
    """Repeatedly merge the pair of regions most likely to be one stroke, until no probability exceeds ``least_chance``.

    Without a perceptron, a pair's mean affinity serves as its probability.
    """
    count = len(superpixels.moments)
    moments = np.concatenate([superpixels.moments, np.zeros_like(superpixels.moments)])
    within = np.concatenate([superpixels.within, np.zeros_like(superpixels.within)])
    around = np.zeros((2 * count, len(AffinityColumn)))
    merge_chance, neighbour_chance = np.ones(2 * count), np.zeros(2 * count)
    children = np.empty((count, 2), np.int64)
    loop, weights = (merge_by_affinity, NO_PERCEPTRON) if perceptron is None else (merge, perceptron)
    merges = loop(
        moments,
        within,
        around,
        merge_chance,
        neighbour_chance,
        superpixels.pairs.copy(),
        superpixels.between.copy(),
        children,
        least_chance,
        weights.mean,
        weights.scale,
        weights.layers,
    )
    nodes = count + merges
    return MergeTree(
        children=children[:merges].copy(),
        moments=moments[:nodes].copy(),
        within=within[:nodes].copy(),
        around=around[:nodes].copy(),
        merge_chance=merge_chance[:nodes].copy(),
        neighbour_chance=neighbour_chance[:nodes].copy(),
    )
