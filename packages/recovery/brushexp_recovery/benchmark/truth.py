"""Represent the ground truth of a painting with known strokes, and store it in a file."""

from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from brushexp.contracts import UserError
from brushexp_recovery.curves.coverage import cover_strokes, overlapping_pairs, visible_labels
from brushexp_recovery.raster.labels import count_pixels, mean_colors
from brushexp_recovery.raster.npz import read_npz, write_npz

Array = NDArray[Any]

VISIBLE_SHARE = 0.3  # minimum visible share of the area of a stroke that counts
VISIBLE_PIXELS = 12  # minimum number of its visible pixels
OVERLAP = 0.05  # minimum overlap of two strokes with an order, as a share of the smaller stroke


@dataclass(frozen=True)
class Truth:
    """N known strokes of a painting in pixels, x to the right and y down; ``depth`` gives their order."""

    labels: Array  # (H, W) int32, the visible stroke, or -1 for the ground
    curve: Array  # (N, 3, 2) control points of the part that carries paint
    width: Array  # (N,) width of a round-ended line with as much paint
    color: Array  # (N, 3) sRGB of the paint in [0, 1]
    seen: Array  # (N, 3) mean sRGB where the stroke is visible
    depth: Array  # (N,) rank; 0 is the bottom
    share: Array  # (N,) visible share of the area
    area: Array  # (N,) pixels, including hidden parts
    pairs: Array  # (P, 2) lower and upper stroke of overlapping pairs

    def __len__(self) -> int:
        return len(self.width)

    @property
    def visible(self) -> Array:
        """Number (N,) of visible pixels of each stroke."""
        return count_pixels(self.labels, len(self))

    @property
    def counts(self) -> Array:
        """Mark the strokes (N,) that are visible enough to be scored."""
        return (self.share >= VISIBLE_SHARE) & (self.visible >= VISIBLE_PIXELS)


def truth_from(labels: Array, area: Array, curve: Array, width: Array, color: Array, image: Array) -> Truth:
    """Compute the full ground truth for N strokes, bottom to top, given the painting ``image`` (H, W, 3) in [0, 1]."""
    count = len(width)
    return Truth(
        labels=labels.astype(np.int32),
        curve=curve,
        width=width,
        color=color,
        seen=mean_colors(labels, image, count),
        depth=np.arange(count, dtype=np.int32),
        share=np.minimum(count_pixels(labels, count) / np.maximum(area, 1), 1),
        area=area,
        pairs=overlapping_pairs(cover_strokes(curve, width, labels.shape), VISIBLE_PIXELS, OVERLAP),
    )


def draw_truth(curve: Array, width: Array, color: Array, size: tuple[int, int], ground: Array) -> tuple[Truth, Array]:
    """Draw opaque strokes, bottom to top, on a plain canvas (H, W); return the ground truth and the image (H, W, 3)."""
    covers = cover_strokes(curve, width, size)
    labels, area = visible_labels(covers, np.ones(len(width)), size)
    image = np.broadcast_to(ground, (*size, 3)).copy()
    for cover, paint in zip(covers, color, strict=True):
        place = cover.box.slices
        image[place] += cover.share[..., None] * (paint - image[place])
    return truth_from(labels, area, curve, width, color, image), image


def write_truth(path: Path, truth: Truth) -> None:
    """Write a ground truth to a compressed npz file."""
    write_npz(path, **{item.name: getattr(truth, item.name) for item in fields(truth)})


def read_truth(path: Path) -> Truth:
    """Read the ground truth of a painting; raise a UserError that says what is missing."""
    values = read_npz(path)
    if missing := [item.name for item in fields(Truth) if item.name not in values]:
        raise UserError(f"{path} has no {missing[0]}; give the npz of a truth written by task=benchmark")
    truth = Truth(**{item.name: values[item.name] for item in fields(Truth)})
    count = len(truth.width)
    shapes = {"curve": (count, 3, 2), "color": (count, 3), "seen": (count, 3)}
    shapes |= dict.fromkeys(("depth", "share", "area"), (count,))
    for name, shape in shapes.items():
        if getattr(truth, name).shape != shape:
            raise UserError(f"{path}: {name} has shape {getattr(truth, name).shape}; {shape} is needed")
    if truth.labels.ndim != 2 or truth.labels.max(initial=-1) >= count:
        raise UserError(f"{path}: labels must be a picture of numbers from -1 to {count - 1}")
    return truth
