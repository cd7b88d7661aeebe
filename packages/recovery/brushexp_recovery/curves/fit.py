"""Fit a stroke to each region: a quadratic curve, a width and a colour."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from brushexp_recovery.find.regions import Regions
from brushexp_recovery.model.channels import CENTRE, DIRECTION, StrokeAttribute
from brushexp_recovery.raster.labels import group_pixels

Array = NDArray[Any]

TAIL = 0.02  # share of a region's pixels beyond each end of its stroke
HIDDEN_WEIGHT = 0.5  # weight of the predicted end of a stroke if it lies beyond its region
DIRECTION_WEIGHT = 0.6  # weight of the predicted direction; the shape's direction is weighted by its elongation
CAP = 0.42  # distance in widths between the end of a curve and its round tip
STRAIGHTNESS = 0.02  # regularisation of a middle line towards the axis
FLATNESS = 0.3  # regularisation of a middle line towards a straight line


class StrokeCurves(NamedTuple):
    """N strokes, each with a curve, a width and a colour."""

    curve: Array  # (N, 3, 2) pixels
    width: Array  # (N,)
    color: Array  # (N, 3) sRGB


def fit_curves(regions: Regions, image: Array) -> StrokeCurves:
    """Fit a stroke to each region of a picture (H, W, 3), in the region's median colour."""
    count = len(regions.chance)
    curve, width, color = np.zeros((count, 3, 2)), np.zeros(count), np.zeros((count, 3))
    for number, pixels in enumerate(group_pixels(regions.labels, count)):
        y, x = np.divmod(pixels, regions.labels.shape[1])
        curve[number], width[number] = fit_curve(np.stack([x, y], 1) + 0.5, regions.attributes[number])
        color[number] = np.median(image[y, x], 0)
    return StrokeCurves(curve, width, color)


def fit_curve(points: Array, attributes: Array) -> tuple[Array, float]:
    """Fit a curve (3, 2) and a width to the points (P, 2) of a region and its predicted `StrokeAttribute`s."""
    middle = points.mean(0)
    axes = main_axes(points - middle, attributes)
    along, across = ((points - middle) @ axes.T).T
    first, last = np.quantile(along, [TAIL, 1 - TAIL])
    visible_width = len(points) / max(last - first, 1)
    stated_width = np.exp(attributes[StrokeAttribute.LOG_WIDTH])
    widest = max(1.5 * visible_width + 1, 0.9 * visible_width)
    width = float(np.clip(stated_width, 0.9 * visible_width, widest))
    centre = (axes @ (attributes[CENTRE] - middle))[0]
    half = 0.5 * np.exp(attributes[StrokeAttribute.LOG_LENGTH])
    low = min(first, first + HIDDEN_WEIGHT * (centre - half - first))
    high = max(last, last + HIDDEN_WEIGHT * (centre + half - last))
    cap = CAP * width
    if high - low > 2 * cap + 1:
        low, high = low + cap, high - cap
    else:
        low, high = 0.5 * (low + high) + np.array([-0.5, 0.5])
    return middle + parabola_curve(middle_line(along, across, width), low, high) @ axes, width


def main_axes(points: Array, attributes: Array) -> Array:
    """Find the axes (2, 2), along and across, of centred points (P, 2) from their shape and predicted direction."""
    xx, yy = (points**2).mean(0) + 1 / 12
    xy = points.prod(1).mean()
    x, y = np.array([xx - yy, 2 * xy]) / (xx + yy) + DIRECTION_WEIGHT * attributes[DIRECTION]
    angle = 0.5 * np.arctan2(y, x)
    return np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])


def middle_line(along: Array, across: Array, width: float) -> Array:
    """Fit a parabola with coefficients (3,) to points (P,), with stronger regularisation for wider strokes."""
    powers = np.stack([np.ones_like(along), along, along * along], 1)
    ridge = np.diag([0, STRAIGHTNESS, FLATNESS * (0.25 * width) ** 2]) * len(along) + 1e-6 * np.eye(3)
    return np.linalg.solve(powers.T @ powers + ridge, powers.T @ across)


def parabola_curve(c: Array, low: float, high: float) -> Array:
    """Return the control points (3, 2) of a parabola with coefficients (3,), between two positions along the axis."""
    middle = 0.5 * (low + high)
    control = c[0] + c[1] * low + c[2] * low**2 + (c[1] + 2 * c[2] * low) * (middle - low)
    start, end = (c[0] + c[1] * t + c[2] * t**2 for t in (low, high))
    return np.array([[low, start], [middle, control], [high, end]])
