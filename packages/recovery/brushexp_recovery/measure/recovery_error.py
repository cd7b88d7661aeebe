"""Correct measures for the errors of recovery, which are estimated on paintings with known strokes.

Recovery misses short strokes, cuts off hidden ends and distorts widths, similarly in every view. `RecoveryError` stores
the differences between true and measured values for paintings with known strokes. Two predictors explain part of these
errors: the mean confidence of the recovered strokes and their median elongatedness. Equally probable errors, derived
from the known paintings, are added to each sample of a measure, so that the median of the samples is corrected for the
mean error, and their spread includes the variation between these errors.

`brushexp_recovery.train.errors_of_measures` fits the errors.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from brushexp_recovery.measure.draws import Draws
from brushexp_recovery.measure.measures import MEASURES, Measure

Array = NDArray[Any]

FILE = Path(__file__).parents[1] / "weights" / "strokes.errors.json"
SURE = 0.02, 0.98  # range to which mean confidences are clamped
SAMPLES = 100  # number of errors added to each draw


@dataclass(frozen=True)
class ErrorOfMeasure:
    """True minus measured values of a measure: log ratios, log-odds differences of fractions, or degrees."""

    mean: float
    slopes: Array  # (2,) change of the mean by standardised `predictors_of`
    rest: Array  # (P,) error of each known painting minus the mean fitted to the other kinds of paintings

    def sample(self, at: Array) -> Array:
        """List equally probable errors (`SAMPLES`,), given standardised predictors (2,).

        A new painting's error is above those of all P known paintings with probability 1 / (P + 1), and below them with
        the same probability.
        """
        chances = (np.arange(SAMPLES) + 0.5) / SAMPLES
        errors: Array = self.mean + at @ self.slopes + np.quantile(self.rest, chances, method="weibull")
        return errors


@dataclass(frozen=True)
class RecoveryError:
    """The errors of all measures in P paintings with known strokes, for one set of weights."""

    weights: str  # hash of the weights
    paintings: tuple[str, ...]  # (P,) names
    predictors: Array  # (P, 2) `predictors_of` the paintings
    errors: Mapping[str, ErrorOfMeasure]  # by name in `MEASURES`

    def correct(self, draws: Draws, confidence: Array) -> Draws:
        """Add every error to each of the samples (views, draws), and return samples (views, draws * `SAMPLES`).

        ``confidence`` (N,) holds the confidences of the strokes found in the photograph. Undefined values stay
        undefined, and predictors are clamped to the range of the known paintings.
        """
        elongatedness = draws["elongatedness"][np.isfinite(draws["elongatedness"])]
        if not len(confidence) or not len(elongatedness):
            return draws
        at = predictors_of(confidence.mean(), np.median(elongatedness))
        at = standardise(np.clip(at, self.predictors.min(0), self.predictors.max(0)), self.predictors)
        corrected = {}
        for name, values in draws.items():
            moved = move(values[..., None], self.errors[name].sample(at), MEASURES[name])
            corrected[name] = moved.reshape(len(values), -1)
        return corrected


def predictors_of(confidence: Any, elongatedness: Any) -> Array:
    """Compute the predictors (..., 2) of errors from the mean confidence and median elongatedness of found strokes."""
    return np.stack([log_odds(np.clip(confidence, *SURE)), np.log(elongatedness)], -1)


def standardise(values: Array, known: Array) -> Array:
    """Standardise predictors (..., 2) by the mean and standard deviation of the known paintings' predictors (P, 2)."""
    scaled: Array = (values - known.mean(0)) / known.std(0)
    return scaled


def log_odds(share: Any) -> Any:
    """Compute the log-odds of fractions in [0, 1], which are infinite at 0 and 1."""
    with np.errstate(divide="ignore"):
        return np.log(share) - np.log1p(-share)


def move(values: Array, error: Array, measure: Measure) -> Array:
    """Add errors to the values of a measure, on the scale defined in `ErrorOfMeasure`."""
    if measure.axial:
        return (values + error) % 180
    if measure.share:
        return 1 / (1 + np.exp(-(log_odds(values) + error)))
    return values * np.exp(error)


@cache
def read_errors(path: Path = FILE) -> RecoveryError:
    """Read the errors of recovery with the shipped weights."""
    data = json.loads(path.read_text(encoding="utf-8"))
    errors = {
        name: ErrorOfMeasure(one["mean"], np.array(one["slopes"]), np.array(one["rest"]))
        for name, one in data["measures"].items()
    }
    return RecoveryError(data["weights"], tuple(data["paintings"]), np.array(data["predictors"]), errors)
