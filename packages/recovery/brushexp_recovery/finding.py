"""Regions of strokes are found in a picture of any size: at the scale that suits it, tile by tile, surest first."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from brushexp_recovery.judges import Asked
from brushexp_recovery.looking import Candidate, Look, lay, look_at, regions_in
from brushexp_recovery.maps import Maps, predict
from brushexp_recovery.model import RecoveryModel
from brushexp_recovery.network import LENGTH, OVER, PAINT, WIDTH
from brushexp_recovery.raster.blur import gaussian_blur
from brushexp_recovery.raster.resampling import nearest_pixels, resample
from brushexp_recovery.raster.threads import map_on_threads
from brushexp_recovery.raster.tiles import Box, split_into_tiles

Array = NDArray[Any]

TILE = 512  # pixels, zoomed, of the side of what is looked at at once
SCALES = (0.15, 3.0)  # to which a picture is brought at most
SOUGHT = 18.0  # pixels: width of the middle stroke; a quarter wider than in training found 2 % more
TRIALS, TRIED = 3, 384  # looks at parts of a picture, so many pixels wide, to guess its scale
DOUBT = 0.05  # by which another scale must explain more of a picture than the guessed one
LOOKS = ((1.0, 0.0), (1.4, 0.0), (0.7, 0.0), (1.0, 1.0))  # at a tile: times the scale, and pixels of blur
HALF = 0.5  # of the mean chance of what is kept: nothing less sure is kept
SETTLED = 0.2  # change of the logarithm of a scale that is not worth another look
ENOUGH = 0.02  # share of paint below which nothing is said of widths
OVER_UNIT = 16  # steps of log-odds in 8 bits
Progress = Callable[[float, str], None]


@dataclass(frozen=True)
class Regions:
    """N regions of a picture, each the visible part of one stroke."""

    labels: Array  # (H, W) int32, 0 to N - 1, -1 where there is none
    chance: Array  # (N,) what all looks say
    told: Array  # (N, 7) centre x, y, cosine and sine of twice the direction, log width, log length, share; pixels
    over: Array  # (len(OVER), H, W) int8, log-odds in 1 / OVER_UNIT that what lies at an offset, zoomed, is above
    zoom: float  # at which it was looked at


def find_regions(model: RecoveryModel, image: Array, zoom: float | None, copies: int, show: Progress) -> Regions:
    """Find regions in a picture (H, W, 3) float32 in [0, 1]; without a ``zoom`` at the one that suits its strokes.

    What is kept is worth half as much as the mean of what is kept, or more: if as many strokes are there as are kept,
    and the worth of each is its chance to be one, no other share has a higher F1 to be expected.
    """
    height, width = image.shape[:2]
    judges = (model.pairs.asked(), model.nodes.asked())
    zoom = find_zoom(model, judges, image) if zoom is None else zoom
    over = np.zeros((len(OVER), height, width), np.int8)

    def look(number: int, box: Box, core: Box) -> Look:  # the maps of a look are freed before the next one
        scale, blur = LOOKS[number]
        shown = resample(image[box[0] : box[1], box[2] : box[3]], zoom * scale)
        shown = gaussian_blur(shown, (blur, blur, 0)) if blur else shown
        maps = predict(model.network, shown, copies, number)
        if number == 0:
            _keep_over(over, maps, box, core)
        return look_at(maps, shown, judges)

    def find(at: tuple[Box, Box]) -> list[Candidate]:
        looks = [look(number, *at) for number in range(len(LOOKS))]
        return [_placed(one, at[0], width) for one in regions_in(looks, *at)]

    places, candidates = list(split_into_tiles(height, width, zoom, TILE)), list[Candidate]()
    for done, found in enumerate(map_on_threads(find, places), start=1):
        candidates += found
        show(done / len(places), f"{len(candidates)} strokes")
    labels = np.full(height * width, -1, np.int32)
    kept = lay(candidates, labels, HALF)
    chance, told = np.array([one.chance for one in kept]), np.array([one.told for one in kept]).reshape(-1, 7)
    return Regions(labels.reshape(height, width), chance, told, over, zoom)


def _placed(one: Candidate, box: Box, width: int) -> Candidate:
    """Number the pixels of a region of a tile as those of the picture."""
    y, x = np.divmod(one.pixels, box[3] - box[2])
    return replace(one, pixels=(y + box[0]) * width + x + box[2])


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
        whole, shown = Box(0, height, 0, width), resample(part, zoom)
        found = regions_in([look_at(predict(model.network, shown, 1), shown, judges)], whole, whole)
        total += sum(len(candidate.pixels) * candidate.chance for candidate in found)
    return total / sum(part.shape[0] * part.shape[1] for part in parts)


def guess_zoom(model: RecoveryModel, image: Array) -> float:
    """Guess the scale at which strokes are as wide as is best for the network, by what it says of their widths."""
    zoom = 1.0
    for _ in range(TRIALS):
        found = [_widths(model, resample(part, zoom)) for part in parts_of(image, TRIED / zoom)]
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


def _keep_over(over: Array, maps: Maps, box: Box, core: Box) -> None:
    """Keep which side is above, in 8 bits, of the core of a tile."""
    rows, columns = (nearest_pixels(extent, size) for extent, size in zip(box.size, maps.over.shape[1:], strict=True))
    rows, columns = rows[core[0] - box[0] : core[1] - box[0]], columns[core[2] - box[2] : core[3] - box[2]]
    levels = np.clip(maps.over * OVER_UNIT, -127, 127).astype(np.int8)
    for channel, level in enumerate(levels):  # one at a time: a tile of a broad brush has millions of pixels
        over[channel, core[0] : core[1], core[2] : core[3]] = level[rows[:, None], columns]
