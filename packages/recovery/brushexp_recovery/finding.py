"""Regions of strokes are found in a picture of any size: from its scale to coarser ones, tile by tile, surest first."""
# mypy: allow-untyped-defs

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from brushexp.compat.compiled import function
from brushexp_recovery.judges import Asked
from brushexp_recovery.maps import Maps, predict
from brushexp_recovery.model import RecoveryModel
from brushexp_recovery.network import LENGTH, OVER, PAINT, WIDTH
from brushexp_recovery.regions import pieces_of
from brushexp_recovery.tiling import Box, box_size, giving_back, nearest, on_threads, tiles, zoomed
from brushexp_recovery.tree import Tree, cut, grow, node_features

Array = NDArray[Any]

TILE = 512  # pixels, zoomed, of the side of what is looked at at once
SCALES = (0.15, 3.0)  # to which a picture is brought at most
SOUGHT = 18.0  # pixels: width of the middle stroke; a quarter wider than in training found 2 % more
TRIALS, TRIED = 3, 384  # looks at parts of a picture, so many pixels wide, to guess its scale
DOUBT = 0.05  # by which another scale must explain more of a picture than the guessed one
COARSER = (1.0, 0.7, 0.5)  # of the scale: strokes that are sought in what is left, one after the other
LEAST = 12  # pixels of a region
PRICE = 0.42  # of a region: it is kept if its chance is higher
CERTAIN = 0.85  # weight of the chance of an IoU of 0.5, beside the expected IoU, in what a region is worth
FREE = 0.6  # share of a region that surer ones must leave to it
SETTLED = 0.2  # change of the logarithm of a scale that is not worth another look
ENOUGH = 0.02  # share of paint below which nothing is said of widths
OVER_UNIT = 16  # steps of log-odds in 8 bits
Progress = Callable[[float, str], None]


@dataclass(frozen=True)
class Regions:
    """N regions of a picture, each the visible part of one stroke."""

    labels: Array  # (H, W) int32, 0 to N - 1, -1 where there is none
    chance: Array  # (N,) what the judge says
    told: Array  # (N, 7) centre x, y, cosine and sine of twice the direction, log width, log length, share; pixels
    over: Array  # (len(OVER), H, W) int8, log-odds in 1 / OVER_UNIT that what lies at an offset, zoomed, is above
    zoom: float  # at which it was looked at


@dataclass(frozen=True)
class Candidate:
    """A region as one tile shows it."""

    pixels: Array  # flat numbers in the picture, int32
    chance: float
    told: Array  # (7,)


@giving_back()
def find_regions(model: RecoveryModel, image: Array, zoom: float | None, copies: int, show: Progress) -> Regions:
    """Find regions in a picture (H, W, 3) float32 in [0, 1]; without a ``zoom`` at the one that suits its strokes.

    What is found at the first scale is laid before what coarser ones show: a group of strokes, seen small, looks like
    one.
    """
    height, width = image.shape[:2]
    judges = (model.pairs.asked(), model.nodes.asked())
    zoom = find_zoom(model, judges, image) if zoom is None else zoom
    over = np.zeros((len(OVER), height, width), np.int8)
    labels, kept = np.full(height * width, -1, np.int32), list[Candidate]()

    def look(part: float, at: tuple[Box, Box]) -> list[Candidate]:
        box, core = at
        shown = zoomed(image[box[0] : box[1], box[2] : box[3]], zoom * part)
        maps = predict(model.network, shown, copies)
        if part == COARSER[0]:
            _keep_over(over, maps, box, core)
        found = regions_in(maps, shown, judges, box, core, width)
        return [one for one in found if fits(one.pixels, labels)]

    looks = [list(tiles(height, width, zoom * part, TILE)) for part in COARSER]
    done, total = 0, sum(map(len, looks))
    for part, places in zip(COARSER, looks, strict=True):
        candidates: list[Candidate] = []
        for found in on_threads(partial(look, part), places):
            candidates += found
            done += 1
            show(done / total, f"{len(kept) + len(candidates)} strokes")
        kept += lay(candidates, labels, len(kept))
    chance = np.array([one.chance for one in kept])
    told = np.array([one.told for one in kept]).reshape(-1, 7)
    return Regions(labels.reshape(height, width), chance, told, over, zoom)


def find_zoom(model: RecoveryModel, judges: tuple[Asked, Asked], image: Array) -> float:
    """Find the scale at which strokes are sought first.

    It is the one at which the network takes strokes to be as wide as it likes them, unless the picture's own scale, or
    the one half-way to it, explains more: grain and canvas, enlarged enough, look like strokes, but the network is not
    sure of them.
    """
    guess = guess_zoom(model, image)
    if abs(np.log(guess)) < SETTLED:
        return guess
    middle = float(np.sqrt(guess))
    parts = parts_of(image, TRIED / middle)
    worth = {zoom: explained(model, judges, parts, zoom) for zoom in (guess, middle, 1.0)}
    worth[guess] *= 1 + DOUBT
    return max(worth, key=lambda zoom: worth[zoom])


def explained(model: RecoveryModel, judges: tuple[Asked, Asked], parts: list[Array], zoom: float) -> float:
    """Compute the share of parts of a picture that lies in regions at a scale, each weighted by its chance."""
    total = 0.0
    for part in parts:
        height, width = part.shape[:2]
        whole, shown = (0, height, 0, width), zoomed(part, zoom)
        found = regions_in(predict(model.network, shown, 1), shown, judges, whole, whole, width)
        total += sum(len(candidate.pixels) * candidate.chance for candidate in found)
    return total / sum(part.shape[0] * part.shape[1] for part in parts)


def guess_zoom(model: RecoveryModel, image: Array) -> float:
    """Guess the scale at which strokes are as wide as is best for the network, by what it says of their widths."""
    zoom = 1.0
    for _ in range(TRIALS):
        found = [_widths(model, zoomed(part, zoom)) for part in parts_of(image, TRIED / zoom)]
        widths, strokes = np.concatenate(found, 1)
        if not len(widths):
            break
        change = SOUGHT / middle_of(widths, strokes)
        before, zoom = zoom, float(np.clip(zoom * change, *SCALES))
        if abs(np.log(zoom / before)) < SETTLED:
            break
    return zoom


def middle_of(values: Array, weights: Array) -> float:
    """Compute the median of values (N,) with weights (N,)."""
    order = np.argsort(values)
    total = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(total, 0.5 * total[-1])])


def parts_of(image: Array, side: float) -> list[Array]:
    """Cut up to four parts out of a picture, from the middles of its quarters, or the one in its middle."""
    height, width = image.shape[:2]
    extent = [min(int(side) + 1, size) for size in (height, width)]
    places = (0.5,) if max(height, width) < 2 * side else (0.25, 0.75)
    corners = [
        [int(place * (size - part)) for place in places] for size, part in zip((height, width), extent, strict=True)
    ]
    return [image[y : y + extent[0], x : x + extent[1]] for y in corners[0] for x in corners[1]]


def _widths(model: RecoveryModel, part: Array) -> Array:
    """Guess, of each pixel with paint, the width of its stroke and the share of a stroke that the pixel is (2, P)."""
    geometry = predict(model.network, part, 1).geometry
    paint = geometry[PAINT] > 0
    paint &= paint.mean() > ENOUGH
    wide, long = geometry[WIDTH][paint], geometry[LENGTH][paint]
    return np.stack([np.exp(wide), np.exp(-wide - long)])


def regions_in(
    maps: Maps, image: Array, judges: tuple[Asked, Asked], box: Box, core: Box, width: int
) -> list[Candidate]:
    """Find the regions of a tile whose middles lie in its core; ``width`` is that of the whole picture."""
    pieces = pieces_of(maps, image)
    tree = grow(pieces, judges[0])
    chance = judges[1](node_features(tree))
    nodes, number = np.unique(cut(tree, value_of(tree, chance)), return_inverse=True)
    rows, columns = (nearest(extent, size) for extent, size in zip(box_size(box), image.shape, strict=False))
    place = np.empty((len(nodes), 3))
    _sum_places(pieces.labels, number, rows, columns, place)
    y, x = (place[:, 1:] / np.maximum(place[:, :1], 1)).T + np.array([[box[0]], [box[2]]])
    own = (nodes >= 0) & (place[:, 0] > 0)
    own &= (core[0] <= y) & (y < core[1]) & (core[2] <= x) & (x < core[3])
    begin = np.cumsum(np.where(own, place[:, 0], 0).astype(np.int64))
    pixels = np.empty(begin[-1], np.int32)
    at = np.where(own, np.concatenate([[0], begin[:-1]]), -1)
    _list_pixels(pieces.labels, number, rows, columns, at, box[0] * width + box[2], width, pixels)
    told = told_of(tree.sums[nodes], np.array(image.shape[:2]) / box_size(box), box)
    parts = np.split(pixels, begin[:-1])
    return [Candidate(parts[k], float(chance[nodes[k], 0]), told[k]) for k in np.flatnonzero(own)]


@function
def _sum_places(pieces, number, rows, columns, place):
    """Write how many pixels each region has in a tile, and the sums of their rows and columns, (N, 3)."""
    place[:] = 0
    for y in range(len(rows)):
        for x in range(len(columns)):
            k = number[pieces[rows[y], columns[x]]]
            place[k, 0] += 1
            place[k, 1] += y
            place[k, 2] += x


@function
def _list_pixels(pieces, number, rows, columns, at, first, width, pixels):
    """Write the flat numbers of the pixels of each region from ``at`` (N,) on; -1 leaves a region out."""
    for y in range(len(rows)):
        for x in range(len(columns)):
            k = number[pieces[rows[y], columns[x]]]
            if at[k] >= 0:
                pixels[at[k]] = first + y * width + x
                at[k] += 1


def value_of(tree: Tree, chance: Array) -> Array:
    """Say what each node is worth: how likely it is a stroke, less its price; ground and crumbs are worth nothing."""
    area = tree.sums[:, 0]
    nothing = (tree.sums[:, 20] < 0.5 * area) | (area < LEAST)
    return np.where(nothing, -1.0, CERTAIN * chance[:, 0] + (1 - CERTAIN) * chance[:, 1] - PRICE)


def told_of(sums: Array, scale: Array, box: Box) -> Array:
    """Read (N, 7) of `Regions.told` off sums of regions of a tile that was zoomed by ``scale``, rows and columns."""
    mean = sums / sums[:, :1]
    zoom = np.log(scale).mean()
    columns = [mean[:, 12] / scale[1] + box[2], mean[:, 13] / scale[0] + box[0], mean[:, 15], mean[:, 16]]
    return np.stack([*columns, mean[:, 17] - zoom, mean[:, 18] - zoom, mean[:, 19]], 1)


def lay(candidates: list[Candidate], labels: Array, first: int) -> list[Candidate]:
    """Lay candidates, the surest first, into labels (H W,) where enough of each is free, numbered from ``first`` on.

    Returns those that were laid, without their pixels, which fill the memory.
    """
    laid: list[Candidate] = []
    for one in sorted(candidates, key=lambda one: -one.chance):
        if fits(one.pixels, labels):
            labels[one.pixels[labels[one.pixels] < 0]] = first + len(laid)
            laid.append(Candidate(one.pixels[:0].copy(), one.chance, one.told))
    return laid


def fits(pixels: Array, labels: Array) -> bool:
    """Tell whether enough pixels of a region are free in labels (H W,)."""
    return bool((labels[pixels] < 0).sum() >= max(FREE * len(pixels), 1))


def _keep_over(over: Array, maps: Maps, box: Box, core: Box) -> None:
    """Keep which side is above, in 8 bits, of the core of a tile."""
    rows, columns = (nearest(extent, size) for extent, size in zip(box_size(box), maps.over.shape[1:], strict=True))
    rows, columns = rows[core[0] - box[0] : core[1] - box[0]], columns[core[2] - box[2] : core[3] - box[2]]
    levels = np.clip(maps.over * OVER_UNIT, -127, 127).astype(np.int8)
    for channel, level in enumerate(levels):  # one at a time: a tile of a broad brush has millions of pixels
        over[channel, core[0] : core[1], core[2] : core[3]] = level[rows[:, None], columns]
