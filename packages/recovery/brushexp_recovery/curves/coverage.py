"""Compute the coverage of round-ended lines along quadratic Bezier curves, and which line is visible at each pixel."""
# mypy: allow-untyped-defs

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from brushexp.contracts.kernels import function
from brushexp_recovery.curves.bezier import points_on
from brushexp_recovery.raster.boxes import Box

Array = NDArray[Any]

PIECES = 24  # number of straight pieces of a curve
COVERED = 0.5  # minimum covered share of a pixel that belongs to a stroke


class Cover(NamedTuple):
    """A stroke's coverage of the pixels in a box on the canvas; all pixels outside the box are uncovered."""

    box: Box
    share: Array  # (h, w) covered share of each pixel in the box, 0 to 1

    @property
    def mask(self) -> Array:
        """Mark the pixels of the box that belong to the stroke."""
        return self.share >= COVERED


NO_COVER = Cover(Box(0, 0, 0, 0), np.empty((0, 0)))


def cover_strokes(curve: Array, width: Array, size: tuple[int, int]) -> list[Cover]:
    """Compute each stroke's coverage as if it were alone on a canvas (H, W); strokes off the canvas have `NO_COVER`."""
    height, canvas_width = size
    covers: list[Cover] = []
    for points, half in zip(points_on(curve, PIECES + 1), 0.5 * width, strict=True):
        left, top = np.maximum(np.floor(points.min(0) - half - 1).astype(int), 0)
        right, bottom = np.minimum(np.ceil(points.max(0) + half + 1).astype(int), (canvas_width, height))
        box = Box(top, bottom, left, right)
        if box.is_empty:
            covers.append(NO_COVER)
            continue
        squared = np.full(box.size, np.inf)
        _lower_to_distance(points, left, top, squared)
        distance = np.sqrt(squared)
        share = np.clip(half + 0.5 - distance, 0, 1) - np.clip(-half + 0.5 - distance, 0, 1)
        covers.append(Cover(box, share))
    return covers


@function
def _lower_to_distance(points, left, top, squared):
    """Lower ``squared`` (h, w) to the squared distance between each pixel centre and a polyline through ``points``."""
    for k in range(len(points) - 1):
        ax, ay = points[k, 0], points[k, 1]
        dx, dy = points[k + 1, 0] - ax, points[k + 1, 1] - ay
        norm = max(dx * dx + dy * dy, 1e-9)
        for i in range(squared.shape[0]):
            for j in range(squared.shape[1]):
                x, y = left + j + 0.5 - ax, top + i + 0.5 - ay
                t = min(max((x * dx + y * dy) / norm, 0.0), 1.0)
                x, y = x - t * dx, y - t * dy
                squared[i, j] = min(squared[i, j], x * x + y * y)


def visible_labels(covers: Sequence[Cover], opacity: Array, size: tuple[int, int]) -> tuple[Array, Array]:
    """Find the visible stroke at each pixel, and the area that each stroke covers.

    Strokes are ordered bottom to top. The visible stroke is the one that contributes most to a pixel, unless the ground
    contributes most.

    Returns:
        labels (H, W) int32, -1 for the ground; area (N,) in pixels, including hidden parts.
    """
    light = np.ones(size)  # light transmitted by the strokes above
    best = np.zeros(size)
    labels = np.full(size, -1, np.int32)
    area = np.zeros(len(covers))
    for number in range(len(covers) - 1, -1, -1):
        cover = covers[number]
        place = cover.box.slices
        area[number] = cover.mask.sum()
        adds = opacity[number] * cover.share * light[place]
        more = adds > best[place]
        best[place] = np.where(more, adds, best[place])
        labels[place] = np.where(more, number, labels[place])
        light[place] *= 1 - opacity[number] * cover.share
    labels[light > best] = -1
    return labels, area


def overlapping_pairs(covers: Sequence[Cover], least_pixels: int, least_share: float) -> Array:
    """List the pairs (P, 2) int32 of overlapping strokes, lower stroke first.

    The strokes of a pair share at least ``least_pixels`` pixels, and at least a fraction ``least_share`` of the smaller
    stroke.
    """
    masks = [cover.mask for cover in covers]
    area = [int(mask.sum()) for mask in masks]
    top, bottom, left, right = np.array([cover.box for cover in covers]).reshape(-1, len(Box._fields)).T
    pairs = []
    for j, (upper, upper_mask) in enumerate(zip(covers, masks, strict=True)):
        box = upper.box
        touch = (top[:j] < box.bottom) & (bottom[:j] > box.top) & (left[:j] < box.right) & (right[:j] > box.left)
        for i in np.flatnonzero(touch).tolist():
            both = box.intersection(covers[i].box)
            shared = upper_mask[both.within(box).slices] & masks[i][both.within(covers[i].box).slices]
            if shared.sum() >= max(least_pixels, least_share * min(area[i], area[j])):
                pairs.append((i, j))
    return np.array(pairs, np.int32).reshape(-1, 2)
