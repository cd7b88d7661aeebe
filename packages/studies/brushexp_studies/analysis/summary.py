"""Summarise the brushwork of a painting in numbers, and compare two paintings."""

import math
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from brushexp.contracts import UserError
from brushexp.contracts.results import (
    DIRECTION_BINS,
    MEASURES,
    RADIUS_PITCHES,
    SIZE_MEASURES,
    Array,
    StrokeTable,
    direction_shares,
    measure_strokes,
    sizes_set_by,
)
from brushexp.contracts.strokes import (
    MIN_OPACITY,
    MIN_WIDTH_PITCHES,
    NEIGHBOURS,
    Measure,
    Saved,
    Strokes,
    is_visible,
    pitch_of,
)

EFFECT_SIZES = ((0.147, "negligible"), (0.33, "small"), (0.474, "medium"), (1.0, "large"))  # Romano et al., 2006
STATISTICS = {"n": "n", "mean": "mean", "sd": "standard deviation", "q25": "25 %", "median": "median", "q75": "75 %"}
COMPARISONS = ("difference", "standardised", "delta", "effect", "distance")
FEW_STROKES = 400  # minimum number of strokes; with fewer, a pitch would be a large share of the canvas
HIDDEN_SHARE = 0.05  # visible share at or below which a stroke counts as hidden

OVERALL = {
    "per_1000_px": Measure("strokes per 1000 px^2", "density of the strokes"),
    "layers": Measure("layers", "areas of all strokes / area of the canvas"),
    "hidden": Measure("hidden strokes", f"share of strokes of which at most {HIDDEN_SHARE:.0%} is visible", unit="%"),
    "direction": Measure("prevailing direction", "mean direction of all strokes", unit="°"),
    "agreement": Measure("agreement", "coherence of all strokes together; 1: parallel, 0: no direction prevails"),
    "coherence": Measure("local coherence", "mean coherence around each stroke"),
    "disorder": Measure("coherence in disorder", f"mean for n = {NEIGHBOURS + 1} random strokes, sqrt(pi / 4 n)"),
    "entropy": Measure("entropy of directions", f"1: all {DIRECTION_BINS} equally frequent, 0: only one occurs"),
}


@dataclass(frozen=True)
class Analysis:
    """Measures of a painting's visible strokes."""

    name: str  # name in tables and figures
    source: str  # path of the catalogue
    size: tuple[int, int]  # height and width of the canvas in pixels
    total: int  # number of strokes in the catalogue
    number: NDArray[np.intp]  # (N,) numbers of the strokes that count, in the catalogue's order
    strokes: Strokes  # the N analysed strokes
    depth: NDArray[np.intp]  # (N,) ranks of these strokes; 0 is the bottom
    pitch: float  # sqrt(pixels of the canvas / N)
    radius: float  # maximum distance of neighbours in pixels
    measures: StrokeTable  # measures of the N strokes; see `measure_strokes`
    sizes_by: str = ""  # setting that determined the strokes' ``SIZE_MEASURES``; see `sizes_set_by`

    def values(self, key: str) -> Array:
        """Return the finite values of one measure, in the unit given in `MEASURES`."""
        values: Array = self.measures[key]
        return in_units(values[np.isfinite(values)], MEASURES[key])

    def relative(self, key: str) -> Array:
        """Return one measure in units of the pitch, which makes canvases of different sizes comparable."""
        return self.values(key) / self.pitch ** MEASURES[key].power


def analysis_of(
    saved: Saved, name: str, source: str, radius: float | None = None, visible: float = 0.0, option: str = "catalogue"
) -> Analysis:
    """Measure the visible strokes of a catalogue.

    Strokes are skipped if they are too faint or too thin (see `strokes.measures.is_visible` and `thinnest_of`), or if
    their visible fraction is below ``visible``. Two strokes are neighbours if they are within ``radius`` pixels of each
    other, or within ``RADIUS_PITCHES`` pitches if ``radius`` is None. If no stroke remains, raises a UserError that
    names ``option``.
    """
    thinnest = thinnest_of(len(saved.strokes), saved.size)
    number = is_visible(saved.strokes, thinnest / MIN_WIDTH_PITCHES).nonzero()[:, 0]
    table = measure_strokes(saved.strokes[number], saved.depth[number], saved.size, radius)
    if visible > 0:
        shares, counts = table.visible, table.visible >= visible
        number = number[torch.from_numpy(counts)]
        table = measure_strokes(saved.strokes[number], saved.depth[number], saved.size, radius)
        table.visible = shares[counts]  # computed with the strokes that do not count
    if not len(number):
        rules = f"opacity {MIN_OPACITY} or more, thickness {thinnest:.3g} pixels or more"
        rules += f", {visible:.0%} of it not hidden" * (visible > 0)
        raise UserError(
            f"{option}={source}: none of its {len(saved.strokes)} strokes is visible ({rules}); give another painting"
        )
    strokes, depth = saved.strokes[number], saved.depth[number].argsort().argsort().numpy()
    pitch = pitch_of(strokes, saved.size)
    radius = RADIUS_PITCHES * pitch if radius is None else radius
    return Analysis(
        name, source, saved.size, len(saved.strokes), number.numpy(), strokes, depth, pitch, radius, table,
        sizes_set_by(saved),
    )  # fmt: skip


def thinnest_of(total: int, size: tuple[int, int]) -> float:
    """Return the minimum thickness, in pixels, at which a stroke is measured."""
    return MIN_WIDTH_PITCHES * math.sqrt(size[0] * size[1] / max(total, FEW_STROKES))


def in_units(values: Array, measure: Measure) -> Array:
    """Convert the values of a measure to its unit; angles are converted from radians to degrees."""
    return np.degrees(values) if measure.unit == "°" else values


def overall_of(analysis: Analysis) -> dict[str, float | None]:
    """Compute the statistics in ``OVERALL``, which describe the whole painting; undefined statistics are None."""
    measures, pixels = analysis.measures, analysis.size[0] * analysis.size[1]
    angle = analysis.values("orientation")
    mean = mean_of_directions(angle) if len(angle) else None
    around = min(NEIGHBOURS, len(measures) - 1) + 1
    return {
        "per_1000_px": 1000 * len(measures) / pixels,
        "layers": float(measures.area.sum()) / pixels,
        "hidden": float((measures.visible <= HIDDEN_SHARE).mean()),
        "direction": None if mean is None else degrees_of(mean),
        "agreement": None if mean is None else min(abs(mean), 1.0),
        "coherence": float(measures.coherence.mean()) if around > 1 else None,
        "disorder": math.sqrt(math.pi / (4 * around)) if around > 1 else None,
        "entropy": entropy_of(angle) if len(angle) else None,
    }


def summary_of(analysis: Analysis) -> dict[str, object]:
    """Summarise an analysis as JSON-serialisable data, with lengths and areas in pixels and in pitches."""
    measures: dict[str, dict[str, object]] = {}
    for key, measure in MEASURES.items():
        measures[key] = {"unit": measure.unit, **statistics_of(analysis.values(key), measure.axial)}
        if key in SIZE_MEASURES and analysis.sizes_by:
            measures[key]["set_by"] = analysis.sizes_by
        if measure.power:
            relative = statistics_of(analysis.relative(key))
            measures[key]["in_pitches"] = {name: value for name, value in relative.items() if name != "n"}
    return {
        "name": analysis.name,
        "sizes_set_by": analysis.sizes_by or None,
        "catalogue": analysis.source,
        "height": analysis.size[0],
        "width": analysis.size[1],
        "strokes": analysis.total,
        "counted": len(analysis.number),
        "pitch": analysis.pitch,
        "radius": analysis.radius,
        "overall": overall_of(analysis),
        "measures": measures,
    }


def comparison_of(one: Analysis, other: Analysis) -> dict[str, dict[str, float | str | None]]:
    """Compare two paintings in every measure, with lengths in pitches and areas in square pitches.

    Each comparison has the ``difference`` between the means (for directions, in (-90, 90]), the ``standardised``
    difference (Cohen's d), Cliff's ``delta`` with its ``effect`` size in words, and the Wasserstein-1 ``distance``.
    """
    return {
        key: compare(one.relative(key), other.relative(key), axial=measure.axial) for key, measure in MEASURES.items()
    }


def statistics_of(values: Array, axial: bool = False) -> dict[str, float | int | None]:
    """Compute the count, mean, standard deviation and quartiles of a sample; undefined statistics are None.

    For directions, which are in degrees, the standard deviation is the angular deviation sqrt((1 - R) / 2) (Batschelet,
    1981), and there are no quartiles.
    """
    statistics: dict[str, float | int | None] = dict.fromkeys(STATISTICS) | {"n": len(values)}
    if not len(values):
        return statistics
    if axial:
        mean = mean_of_directions(values)
        spread = math.degrees(math.sqrt(0.5 * max(1 - abs(mean), 0)))
        return statistics | {"mean": degrees_of(mean), "sd": spread}
    low, middle, high = np.quantile(values, (0.25, 0.5, 0.75)).tolist()
    sd = float(values.std(ddof=1)) if len(values) > 1 else None
    return statistics | {"mean": float(values.mean()), "sd": sd, "q25": low, "median": middle, "q75": high}


def mean_of_directions(angle: Array) -> complex:
    """Return the mean of e^{2 i angle} over directions in degrees; it encodes their coherence and mean direction."""
    return complex(np.exp(2j * np.radians(angle)).mean())


def degrees_of(mean: complex) -> float:
    """Return the direction, in [0, 180) degrees, of a mean computed by `mean_of_directions`."""
    return math.degrees(0.5 * math.atan2(mean.imag, mean.real)) % 180 % 180


def entropy_of(angle: Array) -> float:
    """Compute the normalised entropy of directions, which is 1 if all directions are equally frequent."""
    from scipy.stats import entropy  # noqa: PLC0415  (slow to import)

    return float(entropy(direction_shares(angle), base=DIRECTION_BINS))


def compare(a: Array, b: Array, *, axial: bool) -> dict[str, float | str | None]:
    """Compute the statistics of `comparison_of` for two samples; undefined statistics are None."""
    comparison: dict[str, float | str | None] = dict.fromkeys(COMPARISONS)
    if not len(a) or not len(b):
        return comparison
    if axial:
        turn = mean_of_directions(a) * mean_of_directions(b).conjugate()
        angle = math.degrees(0.5 * math.atan2(turn.imag, turn.real))
        return comparison | {"difference": angle, "distance": circular_distance(a, b)}
    from scipy.stats import mannwhitneyu, wasserstein_distance  # noqa: PLC0415  (slow to import)

    difference, freedom = float(a.mean() - b.mean()), len(a) + len(b) - 2
    spread = math.sqrt((len(a) * a.var() + len(b) * b.var()) / max(freedom, 1))
    delta = float(2 * mannwhitneyu(a, b, method="asymptotic").statistic / (len(a) * len(b)) - 1)
    return {
        "difference": difference,
        "standardised": difference / spread if spread > 0 else None,
        "delta": delta,
        "effect": next(word for limit, word in EFFECT_SIZES if abs(delta) <= limit),
        "distance": float(wasserstein_distance(a, b)),
    }


def circular_distance(a: Array, b: Array) -> float:
    """Compute the Wasserstein-1 distance between two samples of directions in degrees.

    This is the integral of |F - G - m| over half a turn, where F and G are the distribution functions and m is the
    median of F - G (Rabin, Delon and Gousseau, 2011).
    """
    places = np.concatenate([a, b])
    order = places.argsort(kind="stable")
    gap = np.cumsum(np.concatenate([np.full(len(a), 1 / len(a)), np.full(len(b), -1 / len(b))])[order])
    width = np.diff(places[order], append=places.min() + 180)
    rising = gap.argsort()
    half = min(int(np.searchsorted(np.cumsum(width[rising]), 90)), len(gap) - 1)
    return float((np.abs(gap - gap[rising[half]]) * width).sum())
