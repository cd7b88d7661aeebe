"""One part of a picture is looked at several times; regions that most of the looks agree on are the surest."""
# mypy: allow-untyped-defs

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from brushexp_recovery.judges import Asked
from brushexp_recovery.maps import Maps
from brushexp_recovery.raster.labels import group_pixels
from brushexp_recovery.raster.resampling import nearest_pixels
from brushexp_recovery.raster.tiles import Box
from brushexp_recovery.regions import pieces_of
from brushexp_recovery.tree import Tree, cut, grow, node_features, overlaps_of

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

    def places(self, size: tuple[int, ...]) -> tuple[Array, ...]:
        """Return rows and columns that show it as a picture of another size (H, W)."""
        return np.ix_(*(nearest_pixels(extent, own) for extent, own in zip(size, self.pieces.shape, strict=True)))


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
    nodes, place = np.unique(np.append(-1, cut(tree, value)), return_inverse=True)
    number = (place[1:] - 1).astype(np.int32)[pieces.labels]
    return Look(pieces.labels, tree, np.where(nothing, 0, chance.mean(1)), nodes[1:], number)


def agreed(looks: Sequence[Look]) -> list[Array]:
    """Compute, of the regions (N,) that each look has chosen, how far all looks agree on them, 0 to 1.

    A look agrees as far as its best region does: the IoU of the two, times what the judge says of its own. It may be
    any of the tree, also one that the look itself has not chosen. They are compared at the pixels of the first look.
    """
    size = looks[0].pieces.shape
    places = [look.places(size) for look in looks]
    agreements = []
    for one, at in zip(looks, places, strict=True):
        votes = [
            (overlaps_of(other.tree, other.pieces[there], one.number[at], len(one.nodes)) * other.worth[:, None]).max(0)
            for other, there in zip(looks, places, strict=True)
        ]
        agreements.append(np.mean(votes, 0))
    return agreements


def regions_in(looks: Sequence[Look], box: Box, core: Box) -> list[Candidate]:
    """Choose among the regions of several looks at a tile, those whose middles lie in its core."""
    found: list[Candidate] = []
    for look, chance in zip(looks, agreed(looks), strict=True):
        found += _listed(look, chance, box, core)
    height, width = box.size
    return lay(found, np.full(height * width, -1, np.int32), 0.0)


def _listed(look: Look, chance: Array, box: Box, core: Box) -> list[Candidate]:
    """List the regions that a look has chosen, as candidates, if their middles lie in the core."""
    size, listed = box.size, list[Candidate]()
    told = told_of(look.tree.sums[look.nodes], np.array(look.number.shape) / size, box)
    for number, pixels in enumerate(group_pixels(look.number[look.places(size)], len(told))):
        y, x = np.divmod(pixels, size[1])
        if len(y) and core[0] <= box[0] + y.mean() < core[1] and core[2] <= box[2] + x.mean() < core[3]:
            listed.append(Candidate(pixels, float(chance[number]), told[number]))
    return listed


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
