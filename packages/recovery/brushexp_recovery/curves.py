"""A region becomes a stroke: a quadratic curve, a width and a colour."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from brushexp_recovery.finding import Regions
from brushexp_recovery.raster.labels import group_pixels

Array = NDArray[Any]

ENDS = 0.02  # share of a region's pixels beyond either end of its stroke
BELIEF = 0.5  # how far the network's opinion of hidden ends is followed
TURN = 0.6  # weight of the network's opinion of the direction, that of the shape is how long it is
CAP = 0.42  # widths by which a curve ends before its round end
STRAIGHT, FLAT = 0.02, 0.3  # how strongly a middle line is held towards the axis, and towards straight


class Fitted(NamedTuple):
    """N strokes."""

    curve: Array  # (N, 3, 2) pixels
    width: Array  # (N,)
    color: Array  # (N, 3) sRGB


def fit_curves(regions: Regions, image: Array) -> Fitted:
    """Fit a stroke to each region of a picture (H, W, 3)."""
    count = len(regions.chance)
    curve, width, color = np.zeros((count, 3, 2)), np.zeros(count), np.zeros((count, 3))
    for number, pixels in enumerate(group_pixels(regions.labels, count)):
        y, x = np.divmod(pixels, regions.labels.shape[1])
        curve[number], width[number] = fit_curve(np.stack([x, y], 1) + 0.5, regions.told[number])
        color[number] = np.median(image[y, x], 0)
    return Fitted(curve, width, color)


def fit_curve(points: Array, told: Array) -> tuple[Array, float]:
    """Fit a curve (3, 2) and a width to points (P, 2) of a region, with what the network says of it (7,)."""
    middle = points.mean(0)
    axis = axis_of(points - middle, told)
    u, v = ((points - middle) @ axis.T).T
    first, last = np.quantile(u, [ENDS, 1 - ENDS])
    seen = len(points) / max(last - first, 1)
    width = float(np.clip(np.exp(told[4]), 0.9 * seen, max(1.5 * seen + 1, 0.9 * seen)))
    centre, half = (axis @ (told[:2] - middle))[0], 0.5 * np.exp(told[5])
    low = min(first, first + BELIEF * (centre - half - first))
    high = max(last, last + BELIEF * (centre + half - last))
    c = middle_line(u, v, max(last - first, 1.0), width)
    cap = CAP * width
    low, high = (low + cap, high - cap) if high - low > 2 * cap + 1 else (0.5 * (low + high) + np.array([-0.5, 0.5]))
    mid = 0.5 * (low + high)
    control = c[0] + c[1] * low + c[2] * low**2 + (c[1] + 2 * c[2] * low) * (mid - low)
    ends = (c[0] + c[1] * t + c[2] * t**2 for t in (low, high))
    local = np.array([[low, next(ends)], [mid, control], [high, next(ends)]])
    return middle + local @ axis, width


def axis_of(points: Array, told: Array) -> Array:
    """Find the axes (2, 2), along and across, of points (P, 2) around 0: by their shape and by the network."""
    xx, yy = (points**2).mean(0) + 1 / 12
    xy = points.prod(1).mean()
    x, y = np.array([xx - yy, 2 * xy]) / (xx + yy) + TURN * told[2:4]
    angle = 0.5 * np.arctan2(y, x)
    return np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])


def middle_line(u: Array, v: Array, span: float, width: float) -> Array:
    """Fit a parabola (3,) to points along u, held towards straight the more, the shorter it is for its width."""
    powers = np.stack([np.ones_like(u), u, u * u], 1)
    held = np.diag([0, STRAIGHT, FLAT * (0.25 * width) ** 2]) * len(u) + 1e-6 * np.eye(3)
    return np.linalg.solve(powers.T @ powers + held, powers.T @ v)
