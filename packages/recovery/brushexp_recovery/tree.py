"""Regions are joined one pair after another; of the tree of all of them the best disjoint nodes are strokes."""

import heapq
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from brushexp_recovery.judges import Asked
from brushexp_recovery.merging import along, bounded, describe, pair_features
from brushexp_recovery.regions import GROUPS, Pieces

Array = NDArray[Any]

LEAST_CHANCE = 0.05  # of being one stroke, below which two regions are never joined
LARGEST = 8.0  # times the size of a stroke there, beyond which a region is joined no further


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


def grow(pieces: Pieces, judge: Asked, least: float = LEAST_CHANCE) -> Tree:
    """Join the pair that is most likely one stroke, again and again, until no pair has a chance of ``least``."""
    count = len(pieces.sums)
    table = {name: np.zeros((2 * count, getattr(pieces, name).shape[1])) for name in ("sums", "within")}
    sums, within, around = table["sums"], table["within"], np.zeros((2 * count, 2 * GROUPS))
    sums[:count], within[:count] = pieces.sums, pieces.within
    made, urge = np.ones(2 * count), np.zeros(2 * count)
    near: list[dict[int, Array]] = [{} for _ in range(count)]
    heap: list[tuple[float, int, int]] = []
    if len(pieces.pairs):
        chances = judge(pair_features(sums, pieces.pairs, pieces.between))[:, 0]
        for (i, j), between, chance in zip(pieces.pairs.tolist(), pieces.between, chances.tolist(), strict=True):
            near[i][j] = near[j][i] = between
            heap.append((-chance, i, j))
        for side in pieces.pairs.T:
            np.add.at(around, side, pieces.between)
            np.maximum.at(urge, side, chances)
    heap = [entry for entry in heap if -entry[0] > least]
    heapq.heapify(heap)
    children: list[tuple[int, int]] = []
    gone = np.zeros(2 * count, bool)
    while heap:
        chance, i, j = heapq.heappop(heap)
        if gone[i] or gone[j]:
            continue
        new, shared = len(near), near[i][j]
        sums[new], within[new] = sums[i] + sums[j], within[i] + within[j] + shared
        around[new], made[new] = around[i] + around[j] - 2 * shared, -chance
        gone[i] = gone[j] = True
        children.append((i, j))
        near.append(_joined(near, i, j, new))
        if sums[new, 0] > LARGEST * np.exp(sums[new, 17:19].sum() / sums[new, 0]):  # it would touch half a picture
            for other in near[new]:
                del near[other][new]
            near[new] = {}
        if not near[new]:
            continue
        others = np.fromiter(near[new].keys(), int, len(near[new]))
        pairs = np.stack([np.full(len(others), new), others], 1)
        chances = judge(pair_features(sums, pairs, np.stack(list(near[new].values()))))[:, 0]
        urge[new] = chances.max()
        for other, value in zip(others.tolist(), chances.tolist(), strict=True):
            if value > least:
                heapq.heappush(heap, (-value, new, other))
    size = count + len(children)
    parts = (part[:size] for part in (sums, within, around, made, urge))
    return Tree(np.array(children, int).reshape(-1, 2), *parts)


def _joined(near: list[dict[int, Array]], i: int, j: int, new: int) -> dict[int, Array]:
    """Join the neighbours of two regions, and tell these of the new one."""
    joined, less = (near[i], near[j]) if len(near[i]) >= len(near[j]) else (near[j], near[i])
    for other, between in less.items():
        joined[other] = joined[other] + between if other in joined else between
    for gone in (i, j):
        joined.pop(gone, None)
    for other, between in joined.items():
        near[other].pop(i, None)
        near[other].pop(j, None)
        near[other][new] = between
    near[i] = near[j] = {}
    return joined


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
        np.log(one.spread / wide), np.linalg.norm(mean[:, 15:17], axis=1), along(one), np.log((off + 1) / wide),
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
