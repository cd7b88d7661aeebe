"""The truth about a painting whose strokes are known, and its file."""

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

VISIBLE_SHARE = 0.3  # share of its area that must be visible for a stroke to count
VISIBLE_PIXELS = 12  # that must be visible
OVERLAP = 0.05  # share of the smaller of two strokes that must overlap for them to have an order


@dataclass(frozen=True)
class Truth:
    """N known strokes of a painting, bottom to top unless ``depth`` says otherwise; pixels, x to the right, y down."""

    labels: Array  # (H, W) int32, the stroke that is seen, -1 the ground
    curve: Array  # (N, 3, 2) control points of the part that carries paint
    width: Array  # (N,) of a round-ended line with as much paint
    color: Array  # (N, 3) sRGB of its paint, in [0, 1]
    seen: Array  # (N, 3) mean sRGB where it is seen
    depth: Array  # (N,) rank, 0 is the bottom one
    share: Array  # (N,) visible part of its area
    area: Array  # (N,) pixels, hidden parts too
    pairs: Array  # (P, 2) lower and upper stroke of those that overlap

    def __len__(self) -> int:
        return len(self.width)

    @property
    def visible(self) -> Array:
        """Pixels (N,) at which each stroke is seen."""
        return count_pixels(self.labels, len(self))

    @property
    def counts(self) -> Array:
        """Tell which strokes (N,) are visible enough to be looked for."""
        return (self.share >= VISIBLE_SHARE) & (self.visible >= VISIBLE_PIXELS)


def truth_from(labels: Array, area: Array, curve: Array, width: Array, color: Array, image: Array) -> Truth:
    """Complete the truth of N strokes in the order bottom to top; ``image`` (H, W, 3) in [0, 1] is the painting."""
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
    """Draw plain opaque strokes, bottom to top, on a canvas (H, W) of one colour (3,): truth and image (H, W, 3)."""
    covers = cover_strokes(curve, width, size)
    labels, area = visible_labels(covers, np.ones(len(width)), size)
    image = np.broadcast_to(ground, (*size, 3)).copy()
    for cover, paint in zip(covers, color, strict=True):
        place = cover.box.slices
        image[place] += cover.share[..., None] * (paint - image[place])
    return truth_from(labels, area, curve, width, color, image), image


def write_truth(path: Path, truth: Truth) -> None:
    """Write a truth as a compressed npz."""
    write_npz(path, **{item.name: getattr(truth, item.name) for item in fields(truth)})


def read_truth(path: Path) -> Truth:
    """Read the truth of a painting; raise a UserError that says what the file lacks."""
    values = read_npz(path)
    if missing := [item.name for item in fields(Truth) if item.name not in values]:
        raise UserError(f"{path} has no {missing[0]}; give the npz of a truth, as task=benchmark writes it")
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
