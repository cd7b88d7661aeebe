"""Compute the intersection over union between the nodes of a merge tree and the regions of a label image."""
# mypy: allow-untyped-defs

from typing import Any

import numpy as np
from numpy.typing import NDArray

from brushexp.contracts.kernels import function
from brushexp_recovery.join.merge_tree import MergeTree

Array = NDArray[Any]


def node_overlaps(tree: MergeTree, superpixels: Array, regions: Array, count: int) -> Array:
    """Compute the intersection over union (nodes, ``count``), float32, of each node with each of ``count`` regions.

    ``superpixels`` (H, W) holds the leaf of the tree at each pixel, and ``regions`` (H, W) the number of the region.
    """
    table = np.zeros((len(tree.moments), count + 1), np.float32)
    _write_overlaps(superpixels, regions, tree.children, table)
    return table[:, :count]


@function
def _write_overlaps(superpixels, regions, children, table):
    """Count the pixels that each node shares with each region, and divide the counts by the areas of the unions.

    The last column of ``table`` receives the area of each node.
    """
    nodes, count = len(table), table.shape[1] - 1
    area = np.zeros(count, np.float32)
    for y in range(superpixels.shape[0]):
        for x in range(superpixels.shape[1]):
            node, region = superpixels[y, x], regions[y, x]
            table[node, count] += 1
            if region >= 0:
                table[node, region] += 1
                area[region] += 1
    for number in range(len(children)):
        i, j = children[number]
        for k in range(count + 1):
            table[nodes - len(children) + number, k] = table[i, k] + table[j, k]
    for node in range(nodes):
        for k in range(count):
            if table[node, k] > 0:
                table[node, k] /= area[k] + table[node, count] - table[node, k]
