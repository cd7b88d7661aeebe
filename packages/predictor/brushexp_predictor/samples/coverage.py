"""Measure the coverage of intervals on paintings with known strokes."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from brushexp.contracts.strokes import Strokes, closest_parameter, curve_of, half_width_of, point_at
from brushexp_predictor.lay.predicting import Sample
from brushexp_predictor.samples.conformal import Doubt, Scalings, fit_scaling, holds, summarise_samples, weights_of
from brushexp_predictor.samples.kinds import PAINTING_KINDS, STROKE_KINDS, Kind, measure_each, measure_painting
from brushexp_predictor.samples.known import Known

Array = NDArray[Any]

KINDS = {("strokes", name): kind for name, kind in STROKE_KINDS.items()}
KINDS |= {("paintings", name): kind for name, kind in PAINTING_KINDS.items()}
STEP = 2.0  # distance in pixels between the places at which the top stroke is determined
FEWEST_PIXELS = 8  # minimum number of places at which a visible stroke is on top
SEEN = 0.5  # opacity above which a stroke hides the strokes below
AT_ONCE = 512  # number of places per batch


class Evidence(NamedTuple):
    """True values of one measure, and summaries of the samples for each, on the scale of `Kind.inner`."""

    truth: Array  # (T,)
    doubt: Doubt  # summary of the samples of T values
    painting: Array  # (T,) number of each value's painting


Report = Mapping[tuple[str, str], Evidence]  # evidence under the keys of `KINDS`


@dataclass(frozen=True)
class Coverage:
    """Quality of one measure's intervals."""

    share: float  # share of the truths that the intervals contain, with equal weight for each painting
    error: float  # standard error of the share over paintings
    width: float  # mean width; for sizes, the mean factor between the ends
    known: int  # number of truths


def examine(known: Known, number: int, samples: Sequence[Sample]) -> Report:
    """Compare the samples' strokes and measures with the visible strokes and the measures of the known painting."""
    strokes = [sample.strokes for sample in samples]
    size, pitch = known.size, math.sqrt(known.size[0] * known.size[1] / known.told)
    which, places = seen_places(known.strokes, size)
    truth = {("strokes", name): values[which] for name, values in measure_each(known.strokes).items()}
    told = {("strokes", name): values for name, values in measure_at(strokes, places).items()}
    whole, *others = (measure_painting(one, size) for one in (known.strokes, *strokes))
    truth |= {("paintings", name): np.array([value]) for name, value in whole.items()}
    told |= {("paintings", name): np.array([[one[name]] for one in others]) for name in whole}

    def evidence(kind: Kind, truth: Array, values: Array) -> Evidence:
        doubt = summarise_samples(kind.inner(values, pitch), kind.axial)
        return Evidence(kind.inner(truth, pitch), doubt, np.full(len(truth), number))

    return {key: evidence(kind, truth[key], told[key]) for key, kind in KINDS.items()}


@torch.no_grad()
def topmost(strokes: Strokes, places: Tensor) -> Tensor:
    """Find the index (P,) of the top stroke at positions (P, 2: x, y in pixels), or -1 where there is none.

    Strokes are ordered bottom to top. Each stroke is treated as a round-ended line of its width; strokes with an
    opacity below `SEEN` are ignored.
    """
    curve, half = curve_of(strokes), half_width_of(strokes)
    low, high = curve.amin(1) - half[:, None], curve.amax(1) + half[:, None]
    found = torch.full((len(places),), -1)
    for own, part in zip(found.split(AT_ONCE), places.to(curve).split(AT_ONCE), strict=True):
        near = ((part[:, None] >= low) & (part[:, None] <= high)).all(2) & (strokes.opacity >= SEEN)
        place, stroke = near.nonzero(as_tuple=True)
        parameter = closest_parameter(curve[stroke], part[place])
        on = (point_at(curve[stroke], parameter) - part[place]).norm(dim=1) <= half[stroke]
        own.scatter_reduce_(0, place[on], stroke[on], "amax")
    return found


def lattice(size: tuple[int, int], step: float) -> Tensor:
    """Return the centres (rows, columns, 2: x, y) of equal cells, about ``step`` pixels wide, on a canvas (H, W)."""
    rows, columns = (max(1, round(length / step)) for length in size)
    y, x = (torch.arange(rows) + 0.5) * size[0] / rows, (torch.arange(columns) + 0.5) * size[1] / columns
    return torch.stack(torch.meshgrid(x, y, indexing="xy"), 2)


def seen_places(strokes: Strokes, size: tuple[int, int]) -> tuple[Array, Tensor]:
    """Find the visible strokes (K,), and for each a visible point (K, 2) near the centre of its visible part."""
    grid = lattice(size, STEP).flatten(0, 1)
    top, points = topmost(strokes, grid).numpy(), grid.numpy()
    which = np.flatnonzero(np.bincount(top[top >= 0], minlength=len(strokes)) >= FEWEST_PIXELS)
    nearest = []
    for stroke in which:
        own = np.flatnonzero(top == stroke)
        nearest.append(own[((points[own] - points[own].mean(0)) ** 2).sum(1).argmin()])
    return which, grid[nearest]


def measure_at(samples: Iterable[Strokes], places: Tensor) -> dict[str, Array]:
    """Measure the top strokes in S samples at points (P, 2); measures are (S, P), with NaN where there is no stroke."""
    rows: dict[str, list[Array]] = {name: [] for name in STROKE_KINDS}
    for strokes in samples:
        top, each = topmost(strokes, places).numpy(), measure_each(strokes)
        for name, row in rows.items():
            row.append(np.where(top >= 0, each[name][top], np.nan))
    return {name: np.stack(row) for name, row in rows.items()}


def join(reports: Sequence[Report]) -> Report:
    """Concatenate the evidence from several paintings."""

    def concatenate(parts: list[Evidence]) -> Evidence:
        doubt = Doubt(*(np.concatenate(values) for values in zip(*(part.doubt for part in parts), strict=True)))
        truth, painting = (np.concatenate([part[k] for part in parts]) for k in (0, 2))
        return Evidence(truth, doubt, painting)

    return {key: concatenate([one[key] for one in reports]) for key in KINDS}


def fit(report: Report) -> Scalings:
    """Fit the scalings for all measures."""
    return {key: fit_scaling(*report[key], axial=kind.axial) for key, kind in KINDS.items()}


def scale_intervals(report: Report, scalings: Scalings) -> Report:
    """Replace the intervals derived from samples with scaled intervals."""
    return {key: report[key]._replace(doubt=scalings[key](report[key].doubt, kind)) for key, kind in KINDS.items()}


def coverage_of(evidence: Evidence, kind: Kind) -> Coverage:
    """Measure how many of the true values the intervals contain, ignoring undefined values, and how wide they are."""
    known = np.isfinite(evidence.truth)
    right = holds(evidence.truth, evidence.doubt, kind.axial)[known]
    numbers = evidence.painting[known]
    each = np.array([right[numbers == number].mean() for number in np.unique(numbers)])
    width = (evidence.doubt.high - evidence.doubt.low)[known]
    width, weight = (values[np.isfinite(width)] for values in (width, weights_of(numbers)))
    mean = float(np.average(width, weights=weight))
    error = float(each.std(ddof=1) / math.sqrt(len(each))) if len(each) > 1 else float("nan")
    return Coverage(float(each.mean()), error, math.exp(mean) if kind.is_factor else mean, len(right))
