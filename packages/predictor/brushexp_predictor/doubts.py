"""What several samples say together: a middle, how far they are apart, and the interval that holds most of them."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from brushexp_predictor.kinds import HALF_TURN, axial_mean

Array = NDArray[Any]

SHARE = 0.9  # of the truths that an interval is to hold


class Doubt(NamedTuple):
    """What S samples say of (...) quantities; NaN where none of them says anything."""

    middle: Array  # median, or mean direction in degrees in [0, 180)
    spread: Array  # mean distance of the samples from it
    low: Array  # by how much the end of the interval is below it: 0 or less
    high: Array  # and above it


def away_from(values: Array, middle: Array, axial: bool) -> Array:
    """Subtract; of directions in degrees the smaller turn, in [-90, 90)."""
    away = values - middle
    return (away + HALF_TURN / 2) % HALF_TURN - HALF_TURN / 2 if axial else away


def doubt_of(values: Array, axial: bool) -> Doubt:
    """Sum up samples (S, ...), NaN where one says nothing; the interval leaves 5 % of them out at either end."""
    flat = values.reshape(len(values), -1)
    said = np.isfinite(flat).any(0)
    parts = np.full((4, flat.shape[1]), np.nan)
    if said.any():
        part = flat[:, said]
        middle = axial_mean(part).direction if axial else np.nanmedian(part, 0)
        away = away_from(part, middle, axial)
        ends = np.nanquantile(away, (0.5 - SHARE / 2, 0.5 + SHARE / 2), axis=0)
        parts[:, said] = [middle, np.nanmean(np.abs(away), 0), *ends]
    return Doubt(*parts.reshape(4, *values.shape[1:]))


def holds(truth: Array, doubt: Doubt, axial: bool) -> Array:
    """Tell whether intervals (...) hold the truth; one about which nothing is said does not."""
    away = away_from(truth, doubt.middle, axial)
    return (away >= doubt.low) & (away <= doubt.high)
