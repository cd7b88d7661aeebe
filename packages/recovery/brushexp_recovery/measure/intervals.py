"""Compute intervals for the measures of a painting's brushwork.

Strokes are recovered from the photograph and from slightly altered copies of it (`views`). In each view, strokes are
sampled many times, each with a probability equal to its confidence (`draws`). To the measures of each sample, 100
equally probable errors of recovery are added in turn, estimated from paintings with known strokes (`recovery_error`).
The reported value is the median of the resulting samples, and its interval contains 90 % of them.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from brushexp_recovery.measure.draws import Draws
from brushexp_recovery.measure.measures import MEASURES

Array = NDArray[Any]

LEVEL = 0.9  # share of draws in an interval
QUANTILES = ((1 - LEVEL) / 2, 0.5, (1 + LEVEL) / 2)  # lower bound, middle and upper bound
PAIRS = 4000  # number of pairs of draws of two paintings whose differences are computed


@dataclass(frozen=True)
class Interval:
    """A measured value: the median of its samples and the bounds of the central 90 % of them, NaN if undefined."""

    value: float
    low: float
    high: float
    over_strokes: float  # standard deviation within a view, over strokes sampled by their confidence
    over_views: float  # standard deviation of the means of views
    found: float  # median of the draws before their correction


UNDEFINED = Interval(np.nan, np.nan, np.nan, np.nan, np.nan, np.nan)


def intervals_of(draws: Draws, mm: float | None = None, corrected: Draws | None = None) -> dict[str, Interval]:
    """Compute the interval of each measure, in pixels, or in millimetres if ``mm`` per pixel is given.

    If ``corrected`` samples from `RecoveryError.correct` are given, the values and bounds are computed from them.
    """
    intervals = {}
    for name, measure in MEASURES.items():
        factor = measure.factor(mm)
        interval = interval_of(draws[name] * factor, measure.axial)
        if corrected is not None:
            bounds = interval_of(corrected[name] * factor, measure.axial)
            interval = replace(interval, value=bounds.value, low=bounds.low, high=bounds.high)
        intervals[name] = interval
    return intervals


def interval_of(values: Array, axial: bool) -> Interval:
    """Compute the interval of samples (views, draws); axial samples are degrees, with 180 equivalent to 0."""
    finite = values[np.isfinite(values)]
    if not len(finite):
        return UNDEFINED
    centre = np.degrees(0.5 * np.angle(np.exp(2j * np.radians(finite)).mean())) if axial else 0.0
    values = (values - centre + 90) % 180 - 90 if axial else values
    low, middle, high = np.nanquantile(values, QUANTILES)
    defined = values[np.isfinite(values).all(1)]
    over_strokes = defined.std(1).mean() if len(defined) else np.nan
    over_views = defined.mean(1).std() if len(defined) else np.nan
    value = (middle + centre) % 180 if axial else middle
    return Interval(
        value=float(value),
        low=float(value + low - middle),
        high=float(value + high - middle),
        over_strokes=float(over_strokes),
        over_views=float(over_views),
        found=float(value),
    )


def difference_of(one: Draws, other: Draws, mm: tuple[float | None, float | None], seed: int) -> dict[str, Interval]:
    """Compute the differences between two paintings (first minus second), in millimetres if both scales are known."""
    random, differences = np.random.default_rng(seed), {}
    mm = (None, None) if None in mm else mm
    for name, measure in MEASURES.items():
        a = one[name].ravel() * measure.factor(mm[0])
        b = other[name].ravel() * measure.factor(mm[1])
        gap = random.choice(a, PAIRS) - random.choice(b, PAIRS)
        gap = (gap + 90) % 180 - 90 if measure.axial else gap
        differences[name] = interval_of(gap[None], axial=False)
    return differences


def is_apart(difference: Interval) -> bool:
    """Check whether the interval of a difference excludes 0."""
    return difference.low > 0 or difference.high < 0
