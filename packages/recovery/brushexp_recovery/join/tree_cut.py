"""Find the best cut of a merge tree; the nodes of the cut are the strokes."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from brushexp_recovery.join.merge_tree import MergeTree

Array = NDArray[Any]


def best_cut(tree: MergeTree, value: Array) -> Array:
    """Choose the disjoint nodes whose values (nodes,) have the largest sum.

    Only nodes with a positive value are chosen; superpixels outside all chosen nodes stay empty.

    Returns:
        The chosen node of each superpixel (S,), or -1 if there is none.
    """
    count = tree.leaves
    best, taken = np.maximum(value, 0), value > 0
    for number, (i, j) in enumerate(tree.children.tolist()):
        node, apart = count + number, best[i] + best[j]
        taken[node] = value[node] > 0 and value[node] >= apart
        best[node] = value[node] if taken[node] else apart
    chosen = np.where(taken, np.arange(len(value)), -1)
    for number in range(len(tree.children) - 1, -1, -1):
        if chosen[count + number] >= 0:
            chosen[tree.children[number]] = chosen[count + number]
    return chosen[:count]
