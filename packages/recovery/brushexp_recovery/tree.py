"""Regions are joined one pair after another; of the tree of all of them the best disjoint nodes are strokes."""
# mypy: allow-untyped-defs

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from brushexp.compat.compiled import function
from brushexp_recovery.joining import join, join_by_affinity
from brushexp_recovery.judges import Asked
from brushexp_recovery.merging import bounded, describe
from brushexp_recovery.regions import GROUPS, Pieces

Array = NDArray[Any]

LEAST_CHANCE = 0.05  # of being one stroke, below which two regions are never joined
NOTHING = np.empty(0, np.float32), np.empty(0, np.float32), (np.empty((1, 1), np.float32),)  # in place of a judge


@dataclass(frozen=True)
class Tree:
    """S pieces and M joins of them, the nodes S, S + 1, ...; the last axis of all but ``children`` is that of nodes."""

    children: Array  # (M, 2) nodes, each below the node that they make
    sums: Array  # (S + M, SUMS)
    within: Array  # (S + M, 8) affinities inside
    around: Array  # (S + M, 8) to other regions
    made: Array  # (S + M,) chance at which a node was made; 1 of a piece
    urge: Array  # (S + M,) best chance of going on with a neighbour

    @property
    def pieces(self) -> int:
        return len(self.sums) - len(self.children)


def grow(pieces: Pieces, judge: Asked | None, least: float = LEAST_CHANCE) -> Tree:
    """Join the pair that is most likely one stroke, again and again, until no pair has a chance of ``least``.

    Without a judge the chance is the mean affinity.
    """
    count = len(pieces.sums)
    sums, within = (np.concatenate([part, np.zeros_like(part)]) for part in (pieces.sums, pieces.within))
    around, made, urge = np.zeros((2 * count, 2 * GROUPS)), np.ones(2 * count), np.zeros(2 * count)
    children, run = np.empty((count, 2), np.int64), join if judge else join_by_affinity
    weights = (judge.mean, judge.scale, judge.layers) if judge else NOTHING
    pairs, between = pieces.pairs.copy(), pieces.between.copy()  # they are used up
    joins = run(sums, within, around, made, urge, pairs, between, least, children, *weights)
    size = count + joins
    return Tree(children[:joins].copy(), *(part[:size].copy() for part in (sums, within, around, made, urge)))


def node_features(tree: Tree) -> Array:
    """Describe the nodes of a tree, so that a judge can say whether each is a stroke: (S + M, F) float32."""
    one, area = describe(tree.sums), tree.sums[:, 0]
    mean = one.mean
    inside = (tree.within[:, :GROUPS] + 0.5) / (tree.within[:, GROUPS:] + 1)
    outside = (tree.around[:, :GROUPS] + 0.25) / (tree.around[:, GROUPS:] + 0.5)
    wide, long = np.exp(mean[:, 17]), np.exp(mean[:, 18])
    grain = np.sqrt(np.maximum(mean[:, 9:12] - mean[:, 6:9] ** 2, 0.01))
    off, filled = np.linalg.norm(mean[:, 12:14] - mean[:, 1:3], axis=1), np.log(area / (wide * long))
    columns = [
        np.log(area), *inside.T, *outside.T, tree.made, tree.urge, tree.made - tree.urge, *np.log(grain).T,
        np.log(one.spread / wide), np.linalg.norm(mean[:, 15:17], axis=1), one.along, np.log((off + 1) / wide),
        off / long, filled, mean[:, 19], filled - np.log(np.maximum(mean[:, 19], 0.05)), np.log(one.length / long),
        np.log(one.width / wide), np.log(area / (one.length * one.width)), np.log(one.length / one.width),
        mean[:, 17], mean[:, 18], np.sqrt(np.maximum(mean[:, 21] - mean[:, 17] ** 2, 0)),
        np.sqrt(np.maximum(mean[:, 22] - mean[:, 18] ** 2, 0)), mean[:, 20],
        *(np.log((tree.around[:, GROUPS + group] + 1) / np.sqrt(area)) for group in (0, 1)),
        np.log((tree.around[:, 2 * GROUPS - 1] + 1) / area),
    ]  # fmt: skip
    return bounded(columns)


def cut(tree: Tree, value: Array) -> Array:
    """Choose the disjoint nodes whose values (S + M,) have the largest sum: the node of each piece (S,), or -1.

    A node is worth taking if its value is positive; what lies in none is left empty.
    """
    count, best, take = tree.pieces, np.maximum(value, 0), value > 0
    for number, (i, j) in enumerate(tree.children.tolist()):
        node, apart = count + number, best[i] + best[j]
        take[node] = value[node] > 0 and value[node] >= apart
        best[node] = value[node] if take[node] else apart
    chosen = np.where(take, np.arange(len(value)), -1)
    for number in range(len(tree.children) - 1, -1, -1):
        if chosen[count + number] >= 0:
            chosen[tree.children[number]] = chosen[count + number]
    return chosen[:count]


def overlaps_of(tree: Tree, pieces: Array, regions: Array, count: int) -> Array:
    """Compute the IoU (S + M, ``count``) float32 of the nodes of a tree with regions of a picture (H, W), -1 for none.

    ``pieces`` (H, W) says which piece of the tree is at each pixel.
    """
    table = np.zeros((len(tree.sums), count + 1), np.float32)
    _overlap(pieces, regions, tree.children, table)
    return table[:, :count]


@function
def _overlap(pieces, regions, children, table):
    """Count what nodes share with regions, and in the last column their pixels; then divide by the unions."""
    nodes, count = len(table), table.shape[1] - 1
    area = np.zeros(count, np.float32)
    for y in range(pieces.shape[0]):
        for x in range(pieces.shape[1]):
            node, k = pieces[y, x], regions[y, x]
            table[node, count] += 1
            if k >= 0:
                table[node, k] += 1
                area[k] += 1
    for number in range(len(children)):
        i, j = children[number]
        for k in range(count + 1):
            table[nodes - len(children) + number, k] = table[i, k] + table[j, k]
    for node in range(nodes):
        for k in range(count):
            if table[node, k] > 0:
                table[node, k] /= area[k] + table[node, count] - table[node, k]
