"""A picture is cut into small regions without a border through them, and what is known of each is summed up."""
# mypy: allow-untyped-defs

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from brushexp.compat.compiled import function
from brushexp_recovery.maps import Maps
from brushexp_recovery.network import CENTRE, LENGTH, OFFSETS, PAINT, SHARE, TURN, UNIT, WIDTH
from brushexp_recovery.raster.blur import gaussian_blur
from brushexp_recovery.raster.offsets import shift

Array = NDArray[Any]

GROUP = np.array([0, 0, *np.repeat([1, 2, 3], 4)])  # of the offsets, by their distance
GROUPS = 4
DIAGONAL = 0.35  # weight of the offsets of 3 pixels in the strength of a border, that of neighbours is 1
SMOOTH = 0.6  # pixels by which borders are blurred
ROOM = 32  # places for pairs of each region, at first
HASH = 0x9E3779B97F4A7C1  # spreads numbers of pairs over a table (Knuth, 1973)
SUMS = 23  # columns of `sums_of`


@dataclass(frozen=True)
class Pieces:
    """S small regions of a picture, and P pairs of them that the network says something of."""

    labels: Array  # (H, W) int32, 0 to S - 1
    sums: Array  # (S, `SUMS`) see `sums_of`
    within: Array  # (S, 8) sums and numbers of affinities in a region, by `GROUP`
    pairs: Array  # (P, 2)
    between: Array  # (P, 8) of affinities between two regions


def pieces_of(maps: Maps, image: Array) -> Pieces:
    """Cut a picture (H, W, 3) in [0, 1] along the borders that its maps show."""
    labels = cut_at_borders(borders_of(maps.affinity))
    within, pairs, between = affinities_of(labels, maps.affinity)
    return Pieces(labels, sums_of(labels, image, maps.geometry), within, pairs, between)


def borders_of(affinity: Array) -> Array:
    """Compute how strong a border (H, W) goes through each pixel, 0 to 1."""
    total, weights = np.zeros(affinity.shape[1:], np.float32), 0.0
    for channel, (dy, dx) in enumerate(OFFSETS[:6]):
        weight = 1.0 if channel < 2 else DIAGONAL
        apart = torch.from_numpy(1 - affinity[channel])
        apart[apart.shape[0] - dy :] = 0
        if dx:
            apart[:, slice(apart.shape[1] - dx, None) if dx > 0 else slice(0, -dx)] = 0
        total += weight * (apart + shift(apart, -dy, -dx)).numpy()
        weights += 2 * weight
    return total / weights


def cut_at_borders(borders: Array) -> Array:
    """Flood the basins between borders, by watershed: numbers (H, W) from 0."""
    from scipy.ndimage import label, minimum_filter  # noqa: PLC0415
    from skimage.segmentation import watershed  # noqa: PLC0415

    borders = gaussian_blur(borders, SMOOTH)
    seeds, _ = label(borders == minimum_filter(borders, 3), np.ones((3, 3)))
    return np.asarray(watershed(borders, seeds), np.int32) - 1


def affinities_of(labels: Array, affinity: Array) -> tuple[Array, Array, Array]:
    """Sum affinities within regions (S, 8), and between those pairs (P, 2) that have any (P, 8)."""
    count = int(labels.max()) + 1
    room = 2 ** (ROOM * count).bit_length()
    within = np.empty((count, 2 * GROUPS))
    while True:
        keys, between = np.full(room, -1), np.zeros((room, 2 * GROUPS))
        if _sum_affinities(labels, affinity, np.array(OFFSETS), GROUP, within, keys, between):
            break
        room *= 2
    used = np.flatnonzero(keys >= 0)
    used = used[np.argsort(keys[used])]
    return within, np.stack([keys[used] // count, keys[used] % count], 1), between[used]


@function
def _sum_affinities(labels, affinity, offsets, group, within, keys, between):
    """Write sums and numbers of affinities; False if the pairs fill more than half of their table.

    ``keys`` (R,) are -1 and get the pairs, smaller x S + larger, each near its hash; R is a power of 2.
    """
    height, width = labels.shape
    count, room, filled, key, place = len(within), len(keys), 0, -1, 0
    within[:] = 0
    for channel in range(len(offsets)):
        dy, dx = offsets[channel]
        one = group[channel]
        for y in range(height - dy):
            for x in range(max(0, -dx), width - max(0, dx)):
                here, there, value = labels[y, x], labels[y + dy, x + dx], affinity[channel, y, x]
                if here == there:
                    within[here, one] += value
                    within[here, GROUPS + one] += 1
                    continue
                pair = min(here, there) * count + max(here, there)
                if pair != key:  # mostly it is that of the pixel before
                    key, place = pair, (pair * HASH >> 20) & (room - 1)
                    while keys[place] != key and keys[place] >= 0:
                        place = (place + 1) & (room - 1)
                    if keys[place] < 0:
                        keys[place] = key
                        filled += 1
                        if 2 * filled > room:
                            return False
                between[place, one] += value
                between[place, GROUPS + one] += 1
    return True


def sums_of(labels: Array, image: Array, geometry: Array) -> Array:
    """Sum over each region (S, `SUMS`) what adds up when regions are joined.

    Columns: 0 pixels; 1 to 5 x, y, xx, xy, yy; 6 to 11 CIELAB and its squares; 12 to 14 centre of the stroke, x and y,
    and its square; 15, 16 cosine and sine of twice the direction; 17, 18 log width and length; 19 share; 20 paint;
    21, 22 squares of 17, 18.
    """
    from skimage.color import rgb2lab  # noqa: PLC0415

    height, width = labels.shape
    rows, columns = np.mgrid[:height, :width] + 0.5
    lab = rgb2lab(image).transpose(2, 0, 1)
    x, y = (place + UNIT * offset for place, offset in zip((columns, rows), geometry[CENTRE], strict=True))
    share, paint = (1 / (1 + np.exp(-geometry[channel])) for channel in (SHARE, PAINT))
    wide, long = geometry[WIDTH], geometry[LENGTH]
    squares = (columns * columns, columns * rows, rows * rows)
    shape = (np.ones((height, width)), columns, rows, *squares, *lab, *lab**2, x, y, x * x + y * y)
    maps = (*shape, *geometry[TURN], wide, long, share, paint, wide**2, long**2)
    flat, count = labels.ravel(), int(labels.max()) + 1
    return np.stack([np.bincount(flat, values.ravel(), minlength=count) for values in maps], 1)
