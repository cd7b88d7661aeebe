"""The brushwork of a painting in numbers, and how far two of them are apart."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from brushexp.analysis.measures import MEASURES, Array, Measure, Measures, measures_of
from brushexp.analysis.surroundings import doubled
from brushexp.errors import UserError
from brushexp.strokes.brushwork import FAINTEST, THINNEST, counts, pitch_of
from brushexp.strokes.catalogue import Strokes
from brushexp.strokes.storage import Saved

BINS = 18  # of directions, 10 degrees each
FEW = 400  # strokes: in smaller catalogues a stroke counts that would count among so many
HIDDEN = 0.05  # share below which next to nothing of a stroke is seen
SIZES = ((0.147, "negligible"), (0.33, "small"), (0.474, "medium"), (1.0, "large"))  # of an effect, see `effect`


@dataclass(frozen=True)
class Overall:
    """How one number of a whole painting is shown."""

    name: str
    meaning: str
    unit: str = ""


OVERALL = {
    "per_1000_px": Overall("strokes per 1000 px^2", "how dense the strokes lie"),
    "layers": Overall("layers", "areas of all strokes / area of the canvas"),
    "hidden": Overall("hidden strokes", f"share of strokes that others hide but for {HIDDEN:.0%} or less", "%"),
    "direction": Overall("prevailing direction", "mean direction of all strokes", "°"),
    "agreement": Overall("agreement", "coherence of all strokes together; 1 is parallel, 0 no direction prevails"),
    "coherence": Overall("local coherence", "mean of the coherence around each stroke"),
    "disorder": Overall("coherence in disorder", "what chance makes of n strokes around each, sqrt(pi / 4 n)"),
    "entropy": Overall(
        "entropy of directions", f"of the shares of {BINS} directions; 1: all are equally frequent, 0: there is one"
    ),
}  # fmt: skip


@dataclass(frozen=True)
class Analysis:
    """A painting and what was measured of it.

    Attributes:
        name: what it is called in tables and figures.
        source: its file.
        size: height and width of the canvas, pixels.
        total: strokes of the catalogue.
        number: (N,) which of them count, in the order of the catalogue.
        strokes: those N.
        depth: (N,) their ranks among each other, 0 is the bottom one.
        pitch: sqrt(pixels of the canvas / N).
        measures: of the N strokes.
    """

    name: str
    source: str
    size: tuple[int, int]
    total: int
    number: NDArray[np.intp]
    strokes: Strokes
    depth: NDArray[np.intp]
    pitch: float
    measures: Measures

    def values(self, key: str) -> Array:
        """One measure of the strokes for which it is defined, in the unit in which it is shown."""
        found: Array = getattr(self.measures, key)
        return in_units(found[np.isfinite(found)], MEASURES[key])

    def relative(self, key: str) -> Array:
        """The same in a unit that does not depend on the size of the canvas: pitches instead of pixels."""
        return self.values(key) / self.pitch ** MEASURES[key].power


def analysis_of(
    saved: Saved, name: str, source: str, radius: float | None = None, visible: float = 0.0, option: str = "catalogue"
) -> Analysis:
    """Measure the strokes of a catalogue that count, see `strokes.brushwork.counts` and `thinnest_of`.

    Args:
        saved: the catalogue.
        name: what it is to be called.
        source: its file.
        radius: of the neighbourhood, pixels; see `measures_of`.
        visible: share of a stroke that must be seen, or it is left out and is no neighbour of others.
        option: what sets the file, for messages.

    Raises:
        UserError: if none counts.
    """
    thinnest = thinnest_of(len(saved.strokes), saved.size)
    count = counts(saved.strokes, thinnest / THINNEST)
    number = count.nonzero()[:, 0]
    found = _measured(saved, number, radius)
    if visible > 0 and len(number):
        shown = torch.from_numpy(found.visible >= visible)
        seen = found.visible[shown.numpy()]
        number = number[shown]
        found = _measured(saved, number, radius)
        found = Measures(**dict(found.items()) | {"visible": seen}, radius=found.radius)
    if not len(number):
        rules = f"opacity {FAINTEST} or more, thickness {thinnest:.3g} pixels or more"
        rules += f", {visible:.0%} of it not hidden" * (visible > 0)
        raise UserError(
            f"{option}={source}: none of its {len(saved.strokes)} strokes can be seen ({rules}); give another painting"
        )
    strokes = saved.strokes[number]
    depth = saved.depth[number].argsort().argsort().numpy()
    pitch = pitch_of(strokes, saved.size)
    return Analysis(name, source, saved.size, len(saved.strokes), number.numpy(), strokes, depth, pitch, found)


def thinnest_of(total: int, size: tuple[int, int]) -> float:
    """Thickness in pixels below which a stroke does not count: ``THINNEST`` pitches, of at least ``FEW`` strokes.

    The pitch of a single stroke is the whole canvas, of which a fiftieth would be a thick stroke.
    """
    return THINNEST * math.sqrt(size[0] * size[1] / max(total, FEW))


def _measured(saved: Saved, number: Tensor, radius: float | None) -> Measures:
    """The measures of strokes of these numbers alone."""
    return measures_of(saved.strokes[number], saved.depth[number], saved.size, radius)


def in_units(values: Array, measure: Measure) -> Array:
    """Numbers as they are shown: angles in degrees."""
    return np.degrees(values) if measure.unit == "°" else values


def statistics_of(values: Array, axial: bool = False) -> dict[str, float | int | None]:
    """Number, mean, standard deviation, quartiles; None where there is none.

    Of directions in degrees the mean is the mean direction, the standard deviation the angular deviation (Batschelet,
    1981) about it, sqrt((1 - R) / 2) in radians; quartiles they have none.
    """
    if axial and len(values):
        mean = doubled(np.radians(values)).mean()
        around = {"mean": _degrees(mean), "sd": math.degrees(math.sqrt(0.5 * max(1 - abs(mean), 0)))}
        return {"n": len(values), **around, "q25": None, "median": None, "q75": None}
    if not len(values):
        return {"n": 0, "mean": None, "sd": None, "q25": None, "median": None, "q75": None}
    low, middle, high = np.quantile(values, (0.25, 0.5, 0.75)).tolist()
    spread = float(values.std(ddof=1)) if len(values) > 1 else None
    return {"n": len(values), "mean": float(values.mean()), "sd": spread, "q25": low, "median": middle, "q75": high}


def _degrees(mean: complex) -> float:
    """Direction in [0, 180) of a mean of doubled ones."""
    return math.degrees(0.5 * math.atan2(mean.imag, mean.real)) % 180 % 180


def overall_of(found: Analysis) -> dict[str, float | None]:
    """The numbers of ``OVERALL``; None where one is not defined."""
    measures, pixels = found.measures, found.size[0] * found.size[1]
    angle = measures.orientation[np.isfinite(measures.orientation)]
    mean = doubled(angle).mean() if len(angle) else None
    coherence = measures.coherence[np.isfinite(measures.coherence)]
    around = float(measures.neighbours.mean()) + 1
    return {
        "per_1000_px": 1000 * len(measures) / pixels,
        "layers": float(measures.area.sum()) / pixels,
        "hidden": float((measures.visible <= HIDDEN).mean()),
        "direction": None if mean is None else _degrees(mean),
        "agreement": None if mean is None else min(abs(mean), 1.0),
        "coherence": float(coherence.mean()) if len(coherence) else None,
        "disorder": math.sqrt(math.pi / (4 * around)) if around > 1 else None,
        "entropy": entropy_of(angle) if len(angle) else None,
    }


def shares_of(angle: Array) -> Array:
    """Shares (BINS,) of directions in radians; the first bin is about 0, along the lower edge."""
    step = math.pi / BINS
    number = np.floor((angle + 0.5 * step) / step).astype(np.intp) % BINS
    return np.bincount(number, minlength=BINS) / max(len(angle), 1)


def entropy_of(angle: Array) -> float:
    """Entropy of the shares of directions, 1 where all are equally frequent."""
    share = shares_of(angle)
    share = share[share > 0]
    return max(0.0, float(-(share * np.log(share)).sum())) / math.log(BINS)


def summary_of(found: Analysis) -> dict[str, object]:
    """All of it as plain data, in pixels and in pitches."""
    measures: dict[str, dict[str, object]] = {}
    for key, measure in MEASURES.items():
        numbers = statistics_of(found.values(key), measure.axial)
        measures[key] = {"unit": measure.unit, **numbers}
        if measure.power:
            scale = found.pitch**measure.power
            measures[key]["in_pitches"] = {
                name: None if value is None else value / scale for name, value in numbers.items() if name != "n"
            }
    return {
        "name": found.name,
        "catalogue": found.source,
        "height": found.size[0],
        "width": found.size[1],
        "strokes": found.total,
        "counted": len(found.number),
        "pitch": found.pitch,
        "radius": found.measures.radius,
        "overall": overall_of(found),
        "measures": measures,
    }


def comparison_of(one: Analysis, other: Analysis) -> dict[str, dict[str, float | str | None]]:
    """How far two paintings are apart in each measure; lengths in pitches, areas in square pitches.

    Attributes of each:
        difference: mean of the first less that of the other; of directions, the angle from the other to the first, in
            (-90, 90].
        standardised: the difference in standard deviations (pooled; Cohen's d).
        delta: Cliff's (1993): P(a > b) - P(a < b) for a stroke a of the first and b of the other, in [-1, 1].
        effect: delta in words, see `effect`.
        distance: Wasserstein-1, how far a stroke's value must move on average to turn one distribution into the other.
    """
    return {key: _compared(one.relative(key), other.relative(key), measure) for key, measure in MEASURES.items()}


def _compared(a: Array, b: Array, measure: Measure) -> dict[str, float | str | None]:
    names = ("difference", "standardised", "delta", "effect", "distance")
    if not len(a) or not len(b):
        return dict.fromkeys(names)
    if measure.axial:
        turn = doubled(np.radians(a)).mean() * doubled(np.radians(b)).mean().conjugate()
        angle = math.degrees(0.5 * math.atan2(turn.imag, turn.real))
        return dict.fromkeys(names) | {"difference": angle, "distance": transport(a, b, period=180.0)}
    delta = cliffs_delta(a, b)
    standard = standardised(a, b)
    return {
        "difference": float(a.mean() - b.mean()),
        "standardised": standard,
        "delta": delta,
        "effect": effect(delta),
        "distance": transport(a, b),
    }


def standardised(a: Array, b: Array) -> float | None:
    """Difference of means in pooled standard deviations; None if both samples are of single values."""
    freedom = len(a) + len(b) - 2
    if freedom < 1:
        return None
    spread = math.sqrt((len(a) * a.var() + len(b) * b.var()) / freedom)
    return float(a.mean() - b.mean()) / spread if spread > 0 else None


def cliffs_delta(a: Array, b: Array) -> float:
    """P(a > b) - P(a < b) over all pairs of two samples (Cliff, 1993)."""
    ascending = np.sort(b)
    below = int(np.searchsorted(ascending, a, side="left").sum())  # counts of pairs, so that a tie leaves no rounding
    above = len(a) * len(b) - int(np.searchsorted(ascending, a, side="right").sum())
    return (below - above) / (len(a) * len(b))


def effect(delta: float) -> str:
    """Cliff's delta in words, with the limits of Romano et al. (2006)."""
    return next(word for limit, word in SIZES if abs(delta) <= limit)


def transport(a: Array, b: Array, period: float | None = None) -> float:
    """Wasserstein-1 distance of two samples on the line, or on a circle of this ``period``.

    The integral of |F - G|, the difference of both distribution functions; on a circle less its median, which is the
    best place to cut it (Rabin, Delon and Gousseau, 2011).
    """
    places = np.concatenate([a, b])
    order = places.argsort(kind="stable")
    step = np.concatenate([np.full(len(a), 1 / len(a)), np.full(len(b), -1 / len(b))])[order]
    gap = np.cumsum(step)
    gap[-1] = 0.0
    places = places[order]
    if period is None:
        return float((np.abs(gap[:-1]) * np.diff(places)).sum())
    width = np.diff(places, append=places[0] + period)
    rising = gap.argsort()
    half = min(int(np.searchsorted(np.cumsum(width[rising]), 0.5 * period)), len(gap) - 1)
    return float((np.abs(gap - gap[rising[half]]) * width).sum())


def means(found: Analysis) -> Mapping[str, float | None]:
    """One number per measure, for the table of a sweep."""
    return {key: statistics_of(found.values(key), measure.axial)["mean"] for key, measure in MEASURES.items()}
