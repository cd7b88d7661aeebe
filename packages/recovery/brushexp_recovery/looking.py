"""One part of a picture is looked at several times; regions that most of the looks agree on are the surest."""
# mypy: allow-untyped-defs

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from brushexp.compat.compiled import function
from brushexp_recovery.judges import Asked
from brushexp_recovery.maps import Maps
from brushexp_recovery.regions import pieces_of
from brushexp_recovery.tiling import Box, box_size, nearest
from brushexp_recovery.tree import Tree, cut, grow, node_features

Array = NDArray[Any]

LEAST = 12  # pixels of a region
PRICE = 0.42  # of a region in the cut of a tree: it is kept if its chance is higher
CERTAIN = 0.85  # weight of the chance of an IoU of 0.5, beside the expected IoU, in what a region is worth to the cut
FREE = 0.6  # share of a region that surer ones must leave to it


@dataclass(frozen=True)
class Look:
    """What one look at a part of a picture shows: regions, joined in a tree."""

    pieces: Array  # (h, w) int32, the piece at each pixel of what was looked at
    tree: Tree
    worth: Array  # (S + M,) of each node: mean of the chance of an IoU of 0.5 and the expected IoU; 0 of what is none
    nodes: Array  # (N,) of the best cut
    number: Array  # (h, w) int32, which of them is at each pixel; -1 where there is none


@dataclass(frozen=True)
class Candidate:
    """A region as one look at a tile shows it."""

    pixels: Array  # flat numbers in the tile, later in the picture, int32
    chance: float  # mean over the looks of how far their best region agrees with it, times what that is worth
    told: Array  # (7,) of `finding.Regions`


def look_at(maps: Maps, image: Array, judges: tuple[Asked, Asked]) -> Look:
    """Cut a picture (h, w, 3) into pieces, join them, and choose what is a stroke."""
    pieces = pieces_of(maps, image)
    tree = grow(pieces, judges[0])
    chance = judges[1](node_features(tree))
    nothing = (tree.sums[:, 20] < 0.5 * tree.sums[:, 0]) | (tree.sums[:, 0] < LEAST)  # ground and crumbs
    value = np.where(nothing, -1.0, CERTAIN * chance[:, 0] + (1 - CERTAIN) * chance[:, 1] - PRICE)
    nodes, number = np.unique(np.append(cut(tree, value), -1), return_inverse=True)
    number = (number[:-1] - 1).astype(np.int32)[pieces.labels]
    return Look(pieces.labels, tree, np.where(nothing, 0, chance.mean(1)), nodes[1:], number)


def agreed(looks: Sequence[Look]) -> list[Array]:
    """Compute, of the regions (N,) that each look has chosen, how far all looks agree on them, 0 to 1.

    A look agrees as far as its best region does: the IoU of the two, times what the judge says of its own. It may be
    any of the tree, also one that the look itself has not chosen. They are compared at the pixels of the first look.
    """
    height, width = looks[0].pieces.shape
    rows, columns = ([nearest(size, look.pieces.shape[axis]) for look in looks]
                     for axis, size in enumerate((height, width)))  # fmt: skip
    total = []
    for one, y, x in zip(looks, rows, columns, strict=True):
        region, votes = one.number[y[:, None], x], np.zeros(len(one.nodes))
        for other, v, u in zip(looks, rows, columns, strict=True):
            shared = np.zeros((len(other.worth), len(votes) + 1), np.int32)
            best = np.zeros(len(votes))
            _agree(region, other.pieces, v, u, other.tree.children, other.worth, shared, best)
            votes += best
        total.append(votes / len(looks))
    return total


@function
def _agree(region, pieces, rows, columns, children, worth, shared, best):
    """Write how far the best node of a tree agrees with each region (N,).

    ``shared`` (S + M, N + 1) gets the pixels that a node and a region share; those of the node are its last column.
    """
    count, first = len(best), len(worth) - len(children)
    area = np.zeros(count)
    for y in range(len(rows)):
        for x in range(len(columns)):
            node, k = pieces[rows[y], columns[x]], region[y, x]
            shared[node, count] += 1
            if k >= 0:
                shared[node, k] += 1
                area[k] += 1
    for number in range(len(children)):
        i, j = children[number]
        for k in range(count + 1):
            shared[first + number, k] = shared[i, k] + shared[j, k]
    for node in range(len(worth)):
        for k in range(count):
            if shared[node, k] > 0:
                iou = shared[node, k] / (area[k] + shared[node, count] - shared[node, k])
                best[k] = max(best[k], iou * worth[node])


def regions_in(looks: Sequence[Look], box: Box, core: Box) -> list[Candidate]:
    """Choose among the regions of several looks at a tile, those whose middles lie in its core."""
    found: list[Candidate] = []
    for look, chance in zip(looks, agreed(looks), strict=True):
        found += _listed(look, chance, box, core)
    height, width = box_size(box)
    return lay(found, np.full(height * width, -1, np.int32), 0.0)


def _listed(look: Look, chance: Array, box: Box, core: Box) -> list[Candidate]:
    """List the regions that a look has chosen, as candidates, if their middles lie in the core."""
    size = box_size(box)
    rows, columns = (nearest(extent, zoomed) for extent, zoomed in zip(size, look.number.shape, strict=True))
    place = np.zeros((len(look.nodes), 3))
    _sum_places(look.number, rows, columns, place)
    y, x = (place[:, 1:] / np.maximum(place[:, :1], 1)).T + np.array([[box[0]], [box[2]]])
    own = (place[:, 0] > 0) & (core[0] <= y) & (y < core[1]) & (core[2] <= x) & (x < core[3])
    ends = np.cumsum(np.where(own, place[:, 0], 0).astype(np.int64))
    pixels = np.empty(ends[-1] if len(ends) else 0, np.int32)
    at = np.where(own, np.concatenate([[0], ends])[:-1], -1)
    _list_pixels(look.number, rows, columns, at, pixels)
    told = told_of(look.tree.sums[look.nodes], np.array(look.number.shape) / size, box)
    parts = np.split(pixels, ends[:-1])
    return [Candidate(parts[k], float(chance[k]), told[k]) for k in np.flatnonzero(own)]


@function
def _sum_places(number, rows, columns, place):
    """Add up how many pixels each region has in a tile, and their rows and columns, (N, 3)."""
    for y in range(len(rows)):
        for x in range(len(columns)):
            k = number[rows[y], columns[x]]
            if k >= 0:
                place[k, 0] += 1
                place[k, 1] += y
                place[k, 2] += x


@function
def _list_pixels(number, rows, columns, at, pixels):
    """Write the flat numbers of the pixels of each region from ``at`` (N,) on; -1 leaves a region out."""
    for y in range(len(rows)):
        for x in range(len(columns)):
            k = number[rows[y], columns[x]]
            if k >= 0 and at[k] >= 0:
                pixels[at[k]] = y * len(columns) + x
                at[k] += 1


def told_of(sums: Array, scale: Array, box: Box) -> Array:
    """Read (N, 7) of `finding.Regions.told` off sums of regions of a tile zoomed by ``scale``, rows and columns."""
    mean = sums / sums[:, :1]
    zoom = np.log(scale).mean()
    columns = [mean[:, 12] / scale[1] + box[2], mean[:, 13] / scale[0] + box[0], mean[:, 15], mean[:, 16]]
    return np.stack([*columns, mean[:, 17] - zoom, mean[:, 18] - zoom, mean[:, 19]], 1)


def lay(candidates: list[Candidate], labels: Array, share: float) -> list[Candidate]:
    """Lay candidates, the surest first, into labels (P,) of -1 where enough of each is free, and return these.

    None is laid whose chance is below a ``share`` of the mean of those before it.
    """
    laid, total = list[Candidate](), 0.0
    for one in sorted(candidates, key=lambda one: -one.chance):
        if one.chance * len(laid) < share * total:
            break
        free = labels[one.pixels] < 0
        if free.sum() >= max(FREE * len(free), 1):
            labels[one.pixels[free]] = len(laid)
            laid.append(one)
            total += one.chance
    return laid
