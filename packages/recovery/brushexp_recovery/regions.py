"""A picture is cut into small regions without a border through them, and what is known of each is summed up."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from brushexp_recovery.blur import blurred
from brushexp_recovery.maps import Maps, shifted
from brushexp_recovery.network import CENTRE, LENGTH, OFFSETS, PAINT, SHARE, TURN, UNIT, WIDTH

Array = NDArray[Any]

GROUP = np.array([0, 0, *np.repeat([1, 2, 3], 4)])  # of the offsets, by their distance
GROUPS = 4
DIAGONAL = 0.35  # weight of the offsets of 3 pixels in the strength of a border, that of neighbours is 1
SMOOTH = 0.6  # pixels by which borders are blurred
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
        total += weight * (apart + shifted(apart, -dy, -dx)).numpy()
        weights += 2 * weight
    return total / weights


def cut_at_borders(borders: Array) -> Array:
    """Flood the basins between borders, by watershed: numbers (H, W) from 0."""
    from scipy.ndimage import label, minimum_filter  # noqa: PLC0415
    from skimage.segmentation import watershed  # noqa: PLC0415

    borders = blurred(borders, SMOOTH)
    seeds, _ = label(borders == minimum_filter(borders, 3), np.ones((3, 3)))
    return np.asarray(watershed(borders, seeds), np.int32) - 1


def affinities_of(labels: Array, affinity: Array) -> tuple[Array, Array, Array]:
    """Sum affinities within regions (S, 8), and between those pairs (P, 2) that have any (P, 8)."""
    count, (height, width) = int(labels.max()) + 1, labels.shape
    within, keys, values, groups = np.zeros((count, 2 * GROUPS)), [], [], []
    for channel, (dy, dx) in enumerate(OFFSETS):
        left, right, group = max(0, -dx), width - max(0, dx), GROUP[channel]
        if dy >= height or left >= right:
            continue
        here, there = labels[: height - dy, left:right], labels[dy:, left + dx : right + dx]
        value, differ = affinity[channel, : height - dy, left:right], here != there
        same = here[~differ]
        within[:, group] += np.bincount(same, value[~differ], minlength=count)
        within[:, GROUPS + group] += np.bincount(same, minlength=count)
        here, there = here[differ].astype(np.int64), there[differ]
        keys.append(np.minimum(here, there) * count + np.maximum(here, there))
        values.append(value[differ])
        groups.append(np.full(len(here), group))
    if not keys:
        return within, np.empty((0, 2), np.int64), np.empty((0, 2 * GROUPS))
    pair, place = np.unique(np.concatenate(keys), return_inverse=True)
    place, size = place * GROUPS + np.concatenate(groups), GROUPS * len(pair)
    total = np.bincount(place, np.concatenate(values), minlength=size).reshape(-1, GROUPS)
    number = np.bincount(place, minlength=size).reshape(-1, GROUPS)
    return within, np.stack([pair // count, pair % count], 1), np.concatenate([total, number], 1)


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
