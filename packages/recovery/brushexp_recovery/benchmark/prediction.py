"""Convert curves, labels, catalogues and recovered strokes to predictions that can be scored."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from brushexp.contracts.strokes import Saved, curve_of
from brushexp_recovery.benchmark.truth import VISIBLE_PIXELS, VISIBLE_SHARE
from brushexp_recovery.curves.coverage import cover_strokes, visible_labels
from brushexp_recovery.curves.round_line import width_of_line
from brushexp_recovery.raster.labels import count_pixels, group_pixels, mean_colors
from brushexp_recovery.recover.storage import Recovered

Array = NDArray[Any]

GREY = 0.5  # sRGB value of strokes without a colour
TIPS = (0.02, 0.98)  # quantiles of a region's pixels that define its extent


@dataclass(frozen=True)
class Prediction:
    """The N strokes that a method predicts, bottom to top, in pixels, with x to the right and y down."""

    labels: Array  # (H, W) int32, the visible stroke, or -1 for the ground
    curve: Array  # (N, 3, 2)
    width: Array  # (N,)
    color: Array  # (N, 3) sRGB in [0, 1]
    area: Array  # (N,) pixels, including hidden parts
    ordered: bool = True  # whether the order of strokes is meaningful
    confidence: Array | None = None  # (N,) in [0, 1]

    def __len__(self) -> int:
        return len(self.width)

    @property
    def counts(self) -> Array:
        """Mark the strokes (N,) that are visible enough to be scored."""
        visible: Array = count_pixels(self.labels, len(self))
        return (visible >= VISIBLE_SHARE * self.area) & (visible >= VISIBLE_PIXELS)


def prediction_from_curves(
    curve: Array, width: Array, color: Array, opacity: Array, size: tuple[int, int]
) -> Prediction:
    """Make a prediction from round-ended lines, bottom to top, on a canvas (H, W)."""
    labels, area = visible_labels(cover_strokes(curve, width, size), opacity, size)
    return Prediction(labels, curve, width, color, area)


def prediction_from_labels(labels: Array, image: Array | None = None) -> Prediction:
    """Make an unordered prediction from a label image (H, W), in which the ground is -1.

    Each region becomes a straight line along its principal axis, in its mean colour in ``image`` (H, W, 3), or in grey.
    """
    numbers, flat = np.unique(labels[labels >= 0], return_inverse=True)
    compact = np.full(labels.shape, -1, np.int32)
    compact[labels >= 0] = flat
    count = len(numbers)
    curve, width = lines_of(compact, count)
    color = np.full((count, 3), GREY) if image is None else mean_colors(compact, image, count)
    return Prediction(compact, curve, width, color, count_pixels(compact, count).astype(float), ordered=False)


def lines_of(labels: Array, count: int) -> tuple[Array, Array]:
    """Fit a straight line of the same area to each region; return lines (count, 3, 2) and their widths (count,)."""
    curve, width = np.zeros((count, 3, 2)), np.zeros(count)
    for number, pixels in enumerate(group_pixels(labels, count)):
        y, x = np.divmod(pixels, labels.shape[1])
        curve[number], width[number] = line_along(np.stack([x, y], 1) + 0.5)
    return curve, width


def line_along(places: Array) -> tuple[Array, float]:
    """Fit a straight line (3, 2) to a region's pixels (P, 2); return it and the width that gives it the same area."""
    middle = places.mean(0)
    offset = places - middle
    _, axes = np.linalg.eigh(offset.T @ offset)
    axis = axes[:, -1]
    low, high = np.quantile(offset @ axis, TIPS) + np.array([-0.5, 0.5])
    extent = high - low
    width = width_of_line(len(places), extent)
    cap = min(0.5 * width, 0.49 * extent)
    along = np.array([low, 0.5 * (low + high), high]) + cap * np.array([1, 0, -1])
    return middle + along[:, None] * axis, float(width)


def prediction_from_catalogue(saved: Saved, size: tuple[int, int]) -> Prediction:
    """Make a prediction from a catalogue, scaled to the width of a canvas (H, W)."""
    bottom_up, zoom = saved.depth.argsort().numpy(), size[1] / saved.size[1]
    strokes = saved.strokes
    curve = curve_of(strokes).numpy()[bottom_up] * zoom
    width = (strokes.width * strokes.scale).numpy()[bottom_up] * zoom
    color, opacity = strokes.color.numpy()[bottom_up], strokes.opacity.numpy()[bottom_up]
    return prediction_from_curves(curve, width, color, opacity, size)


def prediction_from_recovered(recovered: Recovered) -> Prediction:
    """Make a prediction from recovered strokes, with their visible regions and confidence."""
    prediction = prediction_from_catalogue(recovered.saved, recovered.labels.shape)
    bottom_up = recovered.saved.depth.argsort().numpy()
    rank = np.append(np.argsort(bottom_up), -1)
    labels = rank[recovered.labels].astype(np.int32)
    area = count_pixels(labels, len(prediction)).astype(float)
    return replace(prediction, labels=labels, area=area, confidence=recovered.confidence[bottom_up].astype(float))
