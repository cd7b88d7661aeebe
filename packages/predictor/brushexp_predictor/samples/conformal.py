"""Calibrate intervals: shift and stretch sample intervals so that they have the desired coverage on known paintings.

This is cross-conformal prediction (Vovk, 2015), whose score is the distance from the middle in units of the samples'
spread. A line for the middle is fitted to one half of the known paintings, and the distances between it and the other
half are measured, and vice versa; the factor for the spread is a quantile of all these distances. Thus no painting is
compared with a line that was fitted to it, and all paintings are used. The strokes of a painting are not independent
samples, so each painting has the same weight, regardless of its number of strokes (Lee, Barber and Willett, 2023).
"""

import json
import math
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from brushexp.contracts import UserError
from brushexp.contracts.files import check_format_version, check_plain, explaining, json_of, read_text, write_json
from brushexp_predictor.samples.kinds import HALF_TURN, Kind, axial_mean

Array = NDArray[Any]

COVERAGE = 0.9  # share of the truths that an interval should contain
FORMAT, VERSION = "brushexp intervals", 1
FLOORS = (0.0, 0.25, 1.0, 4.0, 16.0)  # added to the spread, in mean spreads: samples that agree may be wrong
STEEPEST = 2.0  # maximum slope of the middle; a steeper line would lead far beyond the range of known paintings
RIGHT = 90.0  # degrees; the maximum distance between two directions


class Doubt(NamedTuple):
    """Summary of S samples of each quantity (...), with NaN where no sample has a value."""

    middle: Array  # median, or mean direction in degrees in [0, 180)
    spread: Array  # mean distance of the samples from the middle
    low: Array  # lower end of the interval minus the middle, 0 or less
    high: Array  # upper end of the interval minus the middle, 0 or more


def deviation_from(values: Array, middle: Array, axial: bool) -> Array:
    """Subtract the middle from values; for directions, return the smallest equivalent turn, in degrees in [-90, 90)."""
    away = values - middle
    return (away + HALF_TURN / 2) % HALF_TURN - HALF_TURN / 2 if axial else away


def summarise_samples(values: Array, axial: bool) -> Doubt:
    """Summarise samples (S, ...), which are NaN where undefined; intervals exclude 5 % of the samples at each end."""
    flat = values.reshape(len(values), -1)
    said = np.isfinite(flat).any(0)
    parts = np.full((4, flat.shape[1]), np.nan)
    if said.any():
        part = flat[:, said]
        middle = axial_mean(part).direction if axial else np.nanmedian(part, 0)
        away = deviation_from(part, middle, axial)
        ends = np.nanquantile(away, (0.5 - COVERAGE / 2, 0.5 + COVERAGE / 2), axis=0)
        parts[:, said] = [middle, np.nanmean(np.abs(away), 0), *ends]
    return Doubt(*parts.reshape(4, *values.shape[1:]))


def holds(truth: Array, doubt: Doubt, axial: bool) -> Array:
    """Check which intervals (...) contain the true value; undefined intervals do not."""
    away = deviation_from(truth, doubt.middle, axial)
    return (away >= doubt.low) & (away <= doubt.high)


@dataclass(frozen=True)
class Scaling:
    """A mapping from the samples' middle and spread to an interval."""

    offset: float  # added to the middle
    slope: float
    floor: float  # added to the spread
    factor: float  # multiplies spread plus floor

    def __call__(self, doubt: Doubt, kind: Kind) -> Doubt:
        """Compute intervals from summaries of samples, on the scale of `Kind.inner`."""
        middle, half = self.offset + self.slope * doubt.middle, self.factor * (doubt.spread + self.floor)
        if kind.axial:
            return Doubt(middle % HALF_TURN, doubt.spread, -np.minimum(half, RIGHT), np.minimum(half, RIGHT))
        low, middle, high = (kind.clamp(value) for value in (middle - half, middle, middle + half))
        return Doubt(middle, doubt.spread, low - middle, high - middle)


Scalings = Mapping[tuple[str, str], Scaling]  # keyed by "strokes" or "paintings", and by measure


def fit_scaling(truth: Array, doubt: Doubt, painting: Array, axial: bool) -> Scaling:
    """Fit the scaling for one measure.

    Args:
        truth: true values (T,) on the scale of `kinds.Kind.inner`.
        doubt: summary (T,) of the samples of each value.
        painting: number (T,) of each value's painting; even and odd numbers form the two halves.
        axial: whether the values are directions.
    """
    known = np.isfinite(truth) & np.isfinite(doubt.middle)
    truth, middle, spread, painting = truth[known], doubt.middle[known], doubt.spread[known], painting[known]
    weight, level = weights_of(painting), COVERAGE * (1 + 1 / len(np.unique(painting)))

    def line_of(rows: Array) -> tuple[float, float]:
        return (0.0, 1.0) if axial else line_through(middle[rows], truth[rows], weight[rows])

    def error_from(offset: float, slope: float) -> Array:
        return np.abs(deviation_from(truth, offset + slope * middle, axial))

    odd = painting % 2 == 1
    error = np.where(odd, error_from(*line_of(~odd)), error_from(*line_of(odd)))

    def factor_with(floor: float) -> float:
        return weighted_quantile(error / (spread + floor + 1e-9), weight, level)

    def width_with(floor: float) -> float:
        half = factor_with(floor) * (spread + floor)
        return float(np.average(np.minimum(half, RIGHT) if axial else half, weights=weight))

    mean = float(np.average(spread, weights=weight))
    floor = min((share * mean for share in FLOORS), key=width_with)
    return Scaling(*line_of(np.full(len(truth), True)), floor, factor_with(floor))


def weights_of(painting: Array) -> Array:
    """Compute weights (T,) for values, so that the weights of each painting sum to 1."""
    _, inverse, count = np.unique(painting, return_inverse=True, return_counts=True)
    shares: Array = 1 / count[inverse]
    return shares


def line_through(x: Array, y: Array, weight: Array) -> tuple[float, float]:
    """Fit offset and slope by weighted least squares; the slope is in [0, `STEEPEST`], or 1 if x hardly varies."""
    mean_x, mean_y = np.average(x, weights=weight), np.average(y, weights=weight)
    square = np.average((x - mean_x) ** 2, weights=weight)
    slope = np.average((x - mean_x) * (y - mean_y), weights=weight) / square if square > 1e-9 else 1.0
    slope = min(max(slope, 0.0), STEEPEST)
    return float(mean_y - slope * mean_x), float(slope)


def weighted_quantile(values: Array, weight: Array, level: float) -> float:
    """Find the smallest value at which the cumulative weight reaches ``level`` of the total, or the largest value."""
    order = values.argsort()
    above = np.cumsum(weight[order]) >= min(level, 1.0) * weight.sum() * (1 - 1e-12)
    return float(values[order[int(above.argmax())]])


def write_scalings(path: Path, scalings: Scalings, about: Mapping[str, object]) -> None:
    """Write scalings and their description ``about`` as JSON."""
    parts: dict[str, dict[str, Any]] = {of: {} for of, _ in scalings}
    for (of, name), scaling in scalings.items():
        parts[of][name] = asdict(scaling)
    write_json(path, {"format": FORMAT, "format_version": VERSION, **about, **parts})


def read_scalings(path: Path, needs: Mapping[str, object], kinds: Iterable[tuple[str, str]]) -> Scalings:
    """Read scalings; raise UserError unless the file agrees with ``needs`` and includes all ``kinds``."""
    cure = "fit them with task=calibrate"
    with explaining(path, cure):
        data = check_plain(json_of(read_text(path, cure)))
    if not isinstance(data, dict) or data.get("format") != FORMAT:
        raise UserError(f"{path} has no intervals; {cure}")
    try:
        check_format_version(data.get("format_version"), VERSION)
    except UserError as error:
        raise UserError(f"{path} {error}") from error
    for name, value in needs.items():
        if data.get(name) != value:
            raise UserError(f"{path} has intervals for a different {name} than {value}; {cure}")
    try:
        return {(of, name): _scaling(data[of][name]) for of, name in kinds}
    except (KeyError, TypeError, ValueError) as error:
        raise UserError(f"{path} lacks an interval, or one is not a number: {error}; {cure}") from error


def _scaling(values: Mapping[str, float]) -> Scaling:
    scaling = Scaling(*(float(values[name]) for name in ("offset", "slope", "floor", "factor")))
    if not all(map(math.isfinite, asdict(scaling).values())):
        raise ValueError(json.dumps(values))
    return scaling
