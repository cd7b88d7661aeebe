"""Where labels of points go in a plot, so that they cover neither each other nor anything else."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

Box = tuple[float, float, float, float]  # left, lower, right, upper; pixels
Place = tuple[float, float]  # x, y; pixels
GRID = 5.0  # pixels between two places that are tried
GAP = 3.0  # pixels between a label and what is around it
NEAR = 8.0  # pixels from a point: no label begins nearer
ON_LINE = 15  # points of a leader that are looked at


def place(points: Sequence[Place], sizes: Sequence[Place], taken: Sequence[Box], area: Box, far: float) -> list[Box]:
    """A place for a label of each point, as near to it as there is room; one after the other.

    Args:
        points: which are labelled.
        sizes: width and height of each label in pixels.
        taken: what must stay free.
        area: where labels may be.
        far: pixels: largest distance of a label.

    Returns:
        A box for each label. One for which there is no room has no width.
    """
    boxes: list[Box] = []
    around = list(taken)  # and what is written, with its leaders as small boxes along them
    for point, size in zip(points, sizes, strict=True):
        found = (_nearest(point, size, around, boxes, area, reach) for reach in (far / 6, far / 3, far))
        box = next((box for box in found if box is not None), (*point, *point))
        around += [box, *((x, y, x, y) for x, y in leader(point, box))]
        boxes.append(box)
    return boxes


def _nearest(
    point: Place, size: Place, around: Sequence[Box], boxes: Sequence[Box], area: Box, far: float
) -> Box | None:
    """The nearest free place, whose leader crosses no other label; None if there is none."""
    (x, y), (width, height) = point, size
    lefts = np.arange(max(area[0], x - width - far), min(area[2] - width, x + far), GRID)
    lows = np.arange(max(area[1], y - height - far), min(area[3] - height, y + far), GRID)
    left, low = (grid.ravel() for grid in np.meshgrid(lefts, lows))
    right, high = left + width, low + height
    away = np.hypot(np.maximum(np.maximum(left - x, x - right), 0), np.maximum(np.maximum(low - y, y - high), 0))
    free = (away >= NEAR) & (away <= far)
    for one in around:
        beside = (left > one[2] + GAP) | (right < one[0] - GAP)
        free &= beside | (low > one[3] + GAP) | (high < one[1] - GAP)
    for k in np.flatnonzero(free)[away[free].argsort(kind="stable")]:
        box = (float(left[k]), float(low[k]), float(right[k]), float(high[k]))
        line = leader(point, box)
        if not any(crosses(line, other) for other in boxes):
            return box
    return None


def leader(point: Place, box: Box) -> list[Place]:
    """Points along the line from a point to the nearest place of a box."""
    end = (min(max(point[0], box[0]), box[2]), min(max(point[1], box[1]), box[3]))
    shares = np.linspace(0, 1, ON_LINE)
    return [(point[0] + s * (end[0] - point[0]), point[1] + s * (end[1] - point[1])) for s in map(float, shares)]


def crosses(line: Sequence[Place], box: Box) -> bool:
    """Whether one of the points is in the box."""
    return any(box[0] <= x <= box[2] and box[1] <= y <= box[3] for x, y in line)
