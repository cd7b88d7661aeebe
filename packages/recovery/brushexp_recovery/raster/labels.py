"""Process label images, in which each pixel holds the number of its region, or -1 if it belongs to none."""
# mypy: allow-untyped-defs

from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from brushexp.contracts.kernels import function

Array = NDArray[Any]


def count_pixels(labels: Array, count: int) -> Array:
    """Count the pixels of each of ``count`` regions."""
    return np.bincount(labels[labels >= 0], minlength=count)


def mean_colors(labels: Array, image: Array, count: int) -> Array:
    """Compute the mean colour (count, 3) of an image (H, W, 3) in each of ``count`` regions; 0 for an empty region."""
    inside = labels >= 0
    sums = [np.bincount(labels[inside], image[..., channel][inside], count) for channel in range(3)]
    return np.stack(sums, 1) / np.maximum(count_pixels(labels, count), 1)[:, None]


def group_pixels(labels: Array, count: int) -> list[Array]:
    """List the flat indices (int32) of the pixels of each of ``count`` regions."""
    flat = labels.ravel()
    sizes = np.zeros(count + 1, np.int64)
    _count_into(flat, sizes)
    bounds = np.cumsum(sizes)
    order = np.empty(bounds[-1], np.int32)
    _group_into(flat, bounds[:-1].copy(), order)
    return [order[begin:end] for begin, end in pairwise(bounds)]


@function
def _count_into(labels, sizes):
    """Count the pixels of region k in ``sizes[k + 1]``."""
    for k in labels:
        if k >= 0:
            sizes[k + 1] += 1


@function
def _group_into(labels, place, order):
    """Write pixel indices (P,) grouped by region; ``place`` (N,) holds each region's next position and is advanced."""
    for pixel in range(len(labels)):
        k = labels[pixel]
        if k >= 0:
            order[place[k]] = pixel
            place[k] += 1


def color_labels(labels: Array) -> Array:
    """Draw each region in a random colour and the other pixels in black, as a picture (H, W, 3) uint8."""
    colors = np.random.default_rng(0).integers(60, 256, (int(labels.max(initial=-1)) + 2, 3)).astype(np.uint8)
    colors[-1] = 0
    return colors[labels]
