"""Compute the shape of a region from its moments."""
# mypy: allow-untyped-defs

from enum import IntEnum
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from brushexp.contracts.kernels import function
from brushexp_recovery.segment.moments import Moment

Array = NDArray[Any]

SHORTEST_SQUARED = 0.05  # smallest variance across a region, in squared pixels
LEAST_SPREAD_SQUARED = 0.01  # squared pixels


class Shape(IntEnum):
    """Columns that follow the mean `Moment`s in the description of a region."""

    LENGTH = len(Moment)  # length in pixels of the rectangle with the same moments
    WIDTH = len(Moment) + 1
    SPREAD = len(Moment) + 2  # standard deviation of the predicted centre in pixels
    ALIGNMENT = len(Moment) + 3  # alignment of the region's shape with the predicted direction, -1 to 1


DESCRIPTION = len(Moment) + len(Shape)  # number of columns


class RegionShapes(NamedTuple):
    """The mean moments and the shapes of N regions."""

    mean: Array  # (N, len(Moment))
    length: Array  # (N,) length in pixels of the rectangle with the same moments
    width: Array  # (N,)
    spread: Array  # (N,) standard deviation of the predicted centre in pixels
    alignment: Array  # (N,) alignment of the region's shape with the predicted direction, -1 to 1


def shapes_of(moments: Array) -> RegionShapes:
    """Compute the mean moments and the shapes of regions from their summed moments (N, len(Moment))."""
    table = np.empty((len(moments), DESCRIPTION))
    _describe_all(moments, table)
    return RegionShapes(
        table[:, : len(Moment)],
        table[:, Shape.LENGTH],
        table[:, Shape.WIDTH],
        table[:, Shape.SPREAD],
        table[:, Shape.ALIGNMENT],
    )


@function
def _describe_all(moments, table):
    for number in range(len(moments)):
        describe(moments[number], table[number])


@function
def describe(moments, out):
    """Write a region's mean moments and shape to ``out`` (DESCRIPTION,), given its summed moments (len(Moment),)."""
    for k in range(len(Moment)):
        out[k] = moments[k] / moments[Moment.AREA]
    xx = out[Moment.XX] - out[Moment.X] * out[Moment.X] + 1 / 12  # 1 / 12 is the variance within a pixel
    yy = out[Moment.YY] - out[Moment.Y] * out[Moment.Y] + 1 / 12
    xy = out[Moment.XY] - out[Moment.X] * out[Moment.Y]
    half = np.hypot(0.5 * (xx - yy), xy)
    out[Shape.LENGTH] = np.sqrt(12 * (0.5 * (xx + yy) + half))
    out[Shape.WIDTH] = np.sqrt(12 * max(0.5 * (xx + yy) - half, SHORTEST_SQUARED))
    x, y = out[Moment.CENTRE_X], out[Moment.CENTRE_Y]
    out[Shape.SPREAD] = np.sqrt(max(out[Moment.CENTRE_SQUARED] - x * x - y * y, LEAST_SPREAD_SQUARED))
    cosine, sine = out[Moment.COSINE], out[Moment.SINE]
    norms = (2 * half + 1e-3) * (np.hypot(cosine, sine) + 1e-3)
    out[Shape.ALIGNMENT] = ((xx - yy) * cosine + 2 * xy * sine) / norms
