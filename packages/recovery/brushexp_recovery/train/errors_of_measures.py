"""Fit the errors that recovery makes in each measure, on paintings with known strokes."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from brushexp.contracts.files import write_json
from brushexp_recovery.measure.measures import MEASURES, Measure
from brushexp_recovery.measure.recovery_error import (
    ErrorOfMeasure,
    RecoveryError,
    log_odds,
    predictors_of,
    standardise,
)

Array = NDArray[Any]

EDGE = 1e-3  # shares are kept this far from 0 and 1
LEAST = 1.0  # pixels or degrees; smaller values count as this one, because ratios of tiny values are meaningless
RIDGE = 0.3  # penalty of squared slopes, in mean squares of a standardised predictor
DIGITS = 4  # decimals in the file


def fit_errors(
    true: Mapping[str, Array],
    measured: Mapping[str, Array],
    confidence: Array,
    paintings: Sequence[str],
    weights: str,
) -> RecoveryError:
    """Estimate the errors of all measures from P paintings.

    Args:
        true: the true values (P,), keyed by the names in `MEASURES`.
        measured: the measured values (P,), keyed by the names in `MEASURES`.
        confidence: the mean confidence (P,) of the strokes found in each painting.
        paintings: the names (P,) of the paintings, each a kind and a number: ``dabs-3``.
        weights: the hash of the recovery weights.
    """
    kinds = np.array([name.rpartition("-")[0] for name in paintings])
    predictors = predictors_of(confidence, measured["elongatedness"])
    errors = {
        name: fit_error(error_between(true[name], measured[name], measure), predictors, kinds, measure)
        for name, measure in MEASURES.items()
    }
    return RecoveryError(weights, tuple(paintings), predictors, errors)


def error_between(true: Array, measured: Array, measure: Measure) -> Array:
    """Compute the errors (P,), true minus measured values, on the scale of `ErrorOfMeasure`."""
    if measure.axial:
        return (true - measured + 90) % 180 - 90
    if measure.share:
        return log_odds(np.clip(true, EDGE, 1 - EDGE)) - log_odds(np.clip(measured, EDGE, 1 - EDGE))
    least = LEAST if measure.unit in ("px", "°") else np.finfo(float).tiny
    return np.log(np.maximum(true, least)) - np.log(np.maximum(measured, least))


def fit_error(error: Array, predictors: Array, kinds: Array, measure: Measure) -> ErrorOfMeasure:
    """Fit the errors (P,) of a measure as a function of predictors (P, 2); ``kinds`` (P,) are the paintings' kinds.

    The residual of each painting, its ``rest``, is its error minus the mean predicted from paintings of the other
    kinds, so it also contains the differences between kinds.
    """
    at, rest = standardise(predictors, predictors), np.empty(len(error))
    for one in set(kinds):
        others = kinds != one
        mean, slopes = _fit_plane(at[others], error[others], measure)
        rest[~others] = error[~others] - mean - at[~others] @ slopes
    return ErrorOfMeasure(*_fit_plane(at, error, measure), rest)


def _fit_plane(at: Array, error: Array, measure: Measure) -> tuple[float, Array]:
    """Fit a mean and slopes by ridge regression; for directions, whose errors are symmetric, both are 0."""
    if measure.axial:
        return 0.0, np.zeros(at.shape[1])
    middle, mean = at.mean(0), error.mean()
    centred = at - middle
    penalty = RIDGE * len(error) * np.eye(at.shape[1])
    slopes: Array = np.linalg.solve(centred.T @ centred + penalty, centred.T @ (error - mean))
    return float(mean - middle @ slopes), slopes


def write_errors(path: Path, error: RecoveryError) -> None:
    """Write errors to a JSON file that `read_errors` can read."""
    measures = {
        name: {"mean": round(one.mean, DIGITS), "slopes": _round_values(one.slopes), "rest": _round_values(one.rest)}
        for name, one in error.errors.items()
    }
    head = {"format": "brushexp errors of measures", "weights": error.weights, "paintings": list(error.paintings)}
    write_json(path, {**head, "predictors": _round_values(error.predictors), "measures": measures})


def _round_values(values: Array) -> Any:
    """Round the values of an array, and convert it to lists."""
    return np.round(values, DIGITS).tolist()
