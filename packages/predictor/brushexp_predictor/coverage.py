"""How often intervals hold the truth, on paintings whose strokes are known."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from brushexp.strokes.catalogue import Strokes
from brushexp_predictor.conformal import Scalings, fit_scaling, weights_of
from brushexp_predictor.doubts import Doubt, doubt_of, holds
from brushexp_predictor.kinds import OF_PAINTINGS, OF_STROKES, Kind, measure_each, measure_painting
from brushexp_predictor.known import Known
from brushexp_predictor.places import lattice, topmost

Array = NDArray[Any]

KINDS = {"strokes": OF_STROKES, "paintings": OF_PAINTINGS}
STEP = 2.0  # pixels between the places at which it is looked which strokes are seen
LEAST = 8  # such places of a stroke, or it does not count as seen


class Evidence(NamedTuple):
    """Truths of one measure, and what samples say of them, on the scale of `Kind.inner`."""

    truth: Array  # (T,)
    doubt: Doubt  # of (T,)
    painting: Array  # (T,) which of the paintings each is of


Report = Mapping[str, Mapping[str, Evidence]]  # by "strokes" and "paintings", then by measure


@dataclass(frozen=True)
class Coverage:
    """What intervals of one measure are worth."""

    share: float  # of the truths that they hold, each painting counting as one
    error: float  # standard error of it, from painting to painting
    width: float  # mean from end to end; of sizes the mean factor between the ends
    known: int  # truths


def examine(known: Known, number: int, samples: Sequence[Strokes]) -> Report:
    """Compare the strokes of samples with the known ones, where these are seen, and the measures of the whole."""
    size, pitch = known.size, math.sqrt(known.size[0] * known.size[1] / known.told)
    which, places = seen_places(known.strokes, size)
    true = {name: values[which] for name, values in measure_each(known.strokes).items()}
    told = tell_at(samples, places)
    whole = [measure_painting(strokes, size) for strokes in (known.strokes, *samples)]

    def evidence(kind: Kind, truth: Array, values: Array) -> Evidence:
        doubt = doubt_of(kind.inner(values, pitch), kind.axial)
        return Evidence(kind.inner(truth, pitch), doubt, np.full(len(truth), number))

    of_strokes = {name: evidence(kind, true[name], told[name]) for name, kind in OF_STROKES.items()}
    of_paintings = {
        name: evidence(kind, np.array([whole[0][name]]), np.array([[one[name]] for one in whole[1:]]))
        for name, kind in OF_PAINTINGS.items()
    }
    return {"strokes": of_strokes, "paintings": of_paintings}


def seen_places(strokes: Strokes, size: tuple[int, int]) -> tuple[Array, Tensor]:
    """Find the strokes (K,) that are seen, and the place (K, 2) of each that is nearest to the middle of what is."""
    grid = lattice(size, STEP).flatten(0, 1)
    top, points = topmost(strokes, grid).numpy(), grid.numpy()
    which = np.flatnonzero(np.bincount(top[top >= 0], minlength=len(strokes)) >= LEAST)
    nearest = []
    for stroke in which:
        own = np.flatnonzero(top == stroke)
        nearest.append(own[((points[own] - points[own].mean(0)) ** 2).sum(1).argmin()])
    return which, grid[nearest]


def tell_at(samples: Iterable[Strokes], places: Tensor) -> dict[str, Array]:
    """Measure the uppermost strokes of S samples at places (P, 2): (S, P) by measure, NaN where there is none."""
    rows: dict[str, list[Array]] = {name: [] for name in OF_STROKES}
    for strokes in samples:
        top, each = topmost(strokes, places).numpy(), measure_each(strokes)
        for name, row in rows.items():
            row.append(np.where(top >= 0, each[name][top], np.nan))
    return {name: np.stack(row) for name, row in rows.items()}


def join(reports: Sequence[Report]) -> Report:
    """Join what was found on several paintings."""

    def joined(parts: list[Evidence]) -> Evidence:
        doubt = Doubt(*(np.concatenate(values) for values in zip(*(part.doubt for part in parts), strict=True)))
        truth, painting = (np.concatenate([part[k] for part in parts]) for k in (0, 2))
        return Evidence(truth, doubt, painting)

    return {of: {name: joined([one[of][name] for one in reports]) for name in kinds} for of, kinds in KINDS.items()}


def fit(report: Report) -> Scalings:
    """Fit the scalings of all measures."""
    fitted = {
        of: {name: fit_scaling(*report[of][name], axial=kind.axial) for name, kind in kinds.items()}
        for of, kinds in KINDS.items()
    }
    return Scalings(**fitted)


def scaled(report: Report, scalings: Scalings) -> Report:
    """Replace what samples say by the scaled intervals."""
    return {
        of: {
            name: report[of][name]._replace(doubt=getattr(scalings, of)[name](report[of][name].doubt, kind))
            for name, kind in kinds.items()
        }
        for of, kinds in KINDS.items()
    }


def coverage_of(evidence: Evidence, kind: Kind) -> Coverage:
    """Count the truths that intervals hold; truths that are not defined do not count."""
    known = np.isfinite(evidence.truth)
    right = holds(evidence.truth, evidence.doubt, kind.axial)[known]
    numbers = evidence.painting[known]
    each = np.array([right[numbers == number].mean() for number in np.unique(numbers)])
    width = (evidence.doubt.high - evidence.doubt.low)[known]
    width, weight = (values[np.isfinite(width)] for values in (width, weights_of(numbers)))
    mean = float(np.average(width, weights=weight))
    error = float(each.std(ddof=1) / math.sqrt(len(each))) if len(each) > 1 else float("nan")
    return Coverage(float(each.mean()), error, math.exp(mean) if kind.is_factor else mean, len(right))
