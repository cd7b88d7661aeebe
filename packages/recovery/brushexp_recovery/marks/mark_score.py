"""Measure how well strokes agree with marks drawn by people: recall, precision and F1, with confidence intervals.

A mark and a stroke match if the intersection over union of their regions is large enough. Each has at most one partner,
and the best pairs are matched first. People seldom mark every stroke of a picture, so an unmatched stroke is an error
only if it is mostly in the area that the file declares complete, or mostly covered by marks. If the strokes are the
marks of a second person, all unmatched strokes are errors.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from brushexp_recovery.marks.mark_regions import overlaps_of_pixels
from brushexp_recovery.marks.marks_file import Marks
from brushexp_recovery.raster.overlap import MATCH_IOU, Overlaps, pair_best

Array = NDArray[Any]

LEVELS = {"": MATCH_IOU, "_soft": 0.3}  # suffixes of keys, and the minimum intersection over union of a match
SHARE = 0.5  # minimum share of a judged stroke's pixels that lie on marks or in the complete part
SMALLEST = 12  # minimum size in pixels of a judged stroke without a partner
DRAWS = 4000  # number of bootstrap draws
BOUNDS = (0.025, 0.975)


class State(StrEnum):
    """The outcome of the comparison for one mark or one stroke."""

    FOUND = "found"
    MISSED = "missed"
    EXTRA = "extra"
    UNJUDGED = "not judged"


@dataclass(frozen=True)
class Counts:
    """Numbers of marks and strokes by state; counts of several pictures can be added."""

    found: int
    missed: int
    extra: int

    def __add__(self, other: "Counts") -> "Counts":
        return Counts(self.found + other.found, self.missed + other.missed, self.extra + other.extra)


@dataclass(frozen=True)
class MarkScore:
    """N marks and M strokes of one picture, compared at one threshold on the intersection over union."""

    partner: Array  # (N,) stroke of each mark, or -1 if it is missed
    marks: list[State]  # (N,)
    strokes: list[State]  # (M,)

    @property
    def counts(self) -> Counts:
        """Count found marks, missed marks and extra strokes."""
        return Counts(self.marks.count(State.FOUND), self.marks.count(State.MISSED), self.strokes.count(State.EXTRA))


def judged_strokes(marks: Marks, regions: Sequence[Array], strokes: Sequence[Array], size: tuple[int, int]) -> Array:
    """Select the strokes (M,) that are errors if they match no mark; marks and strokes are given as flat indices."""
    known = np.zeros(size, bool)
    for region in regions:
        known.flat[region] = True
    if marks.complete is True:
        known[:] = True
    elif marks.complete:
        left, top, width, height = (round(value) for value in marks.complete)
        known[max(top, 0) : max(top + height, 0), max(left, 0) : max(left + width, 0)] = True
    flat = known.ravel()
    return np.array([len(stroke) >= SMALLEST and flat[stroke].mean() >= SHARE for stroke in strokes], bool)


def score_marks(overlaps: Overlaps, count: int, judged: Array, least_iou: float) -> MarkScore:
    """Pair ``count`` marks with strokes; a stroke without a partner is an error only if it is ``judged`` (M,)."""
    pairs = pair_best(overlaps, least_iou)
    partner = np.full(count, -1)
    partner[pairs.first] = pairs.second
    has_partner = np.isin(np.arange(len(judged)), pairs.second)
    return MarkScore(
        partner,
        [State.FOUND if one >= 0 else State.MISSED for one in partner],
        [
            State.FOUND if paired else State.EXTRA if wrong else State.UNJUDGED
            for paired, wrong in zip(has_partner, judged, strict=True)
        ],
    )


@dataclass(frozen=True)
class Agreement:
    """The agreement between N marks and M strokes of one picture."""

    scores: dict[str, MarkScore]  # scores by the suffixes in `LEVELS`
    best_iou: Array  # (N,) best intersection over union of each mark with any stroke


def compare_regions(marks: Sequence[Array], strokes: Sequence[Array], judged: Array, pixels: int) -> Agreement:
    """Compare marks with strokes, given as lists of flat indices on a canvas of ``pixels`` pixels, at all `LEVELS`."""
    overlaps = overlaps_of_pixels(marks, strokes, pixels)
    best = np.zeros(len(marks))
    np.maximum.at(best, overlaps.first, overlaps.iou)
    scores = {end: score_marks(overlaps, len(marks), judged, least) for end, least in LEVELS.items()}
    return Agreement(scores, best)


def figures_of(counts: Counts, end: str, seed: int) -> dict[str, float]:
    """Compute recall, precision and F1 with the bounds of 95 % intervals, under keys with the suffix ``end``.

    Undefined values are NaN. The intervals are computed by a bootstrap over strokes (Efron, 1979): pairs, missed marks
    and extra strokes are resampled with replacement, so their numbers in each resample are multinomial.
    """
    values = np.array([counts.found, counts.missed, counts.extra], float)
    figures = dict(zip(("recall", "precision", "f1"), _rates(values[None])[:, 0].tolist(), strict=True))
    result = {name + end: value for name, value in figures.items()}
    total = int(values.sum())
    if not total:
        return result | {f"{name}{end}_{bound}": float("nan") for name in figures for bound in ("low", "high")}
    draws = np.random.default_rng(seed).multinomial(total, values / total, DRAWS)
    for name, rates in zip(figures, _rates(draws), strict=True):
        finite = rates[np.isfinite(rates)]
        low, high = np.quantile(finite, BOUNDS).tolist() if len(finite) else (np.nan, np.nan)
        result |= {f"{name}{end}_low": low, f"{name}{end}_high": high}
    return result


def _rates(counts: Array) -> Array:
    """Compute recall, precision and F1 (3, D), NaN where undefined, from numbers (D, 3) of found, missed and extra."""
    found, missed, extra = counts.T.astype(float)
    with np.errstate(invalid="ignore"):
        return np.stack([found / (found + missed), found / (found + extra), 2 * found / (2 * found + missed + extra)])
