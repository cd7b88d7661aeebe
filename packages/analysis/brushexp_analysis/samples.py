"""Statistics of samples of numbers and of directions, and how far two samples are apart."""

import math

import numpy as np

from brushexp.results.stroke_table import DIRECTION_BINS, Array, direction_shares

EFFECT_SIZES = ((0.147, "negligible"), (0.33, "small"), (0.474, "medium"), (1.0, "large"))  # Romano et al., 2006
STATISTICS = ("n", "mean", "sd", "q25", "median", "q75")
COMPARISONS = ("difference", "standardised", "delta", "effect", "distance")


def statistics_of(values: Array, axial: bool = False) -> dict[str, float | int | None]:
    """Compute number, mean, standard deviation and quartiles; None where one is not defined.

    Directions in degrees have the angular deviation sqrt((1 - R) / 2) (Batschelet, 1981) and no quartiles.
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
    """Average e^{2 i angle} of degrees: coherence and doubled mean direction in one complex number."""
    return complex(np.exp(2j * np.radians(angle)).mean())


def degrees_of(mean: complex) -> float:
    """Return the direction in [0, 180) of a mean of doubled ones."""
    return math.degrees(0.5 * math.atan2(mean.imag, mean.real)) % 180 % 180


def entropy_of(angle: Array) -> float:
    """Compute the entropy of the shares of directions, 1 where all are equally frequent."""
    from scipy.stats import entropy  # noqa: PLC0415  (slow to import)

    return float(entropy(direction_shares(angle), base=DIRECTION_BINS))


def compare(a: Array, b: Array, *, axial: bool) -> dict[str, float | str | None]:
    """Compare two samples by the numbers of `summary.comparison_of`; None where one is not defined."""
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
    """Compute the Wasserstein-1 distance of two samples of directions in degrees.

    It is the integral of |F - G - m| over a half turn, F and G being the distribution functions and m the median of
    their difference (Rabin, Delon and Gousseau, 2011).
    """
    places = np.concatenate([a, b])
    order = places.argsort(kind="stable")
    gap = np.cumsum(np.concatenate([np.full(len(a), 1 / len(a)), np.full(len(b), -1 / len(b))])[order])
    width = np.diff(places[order], append=places.min() + 180)
    rising = gap.argsort()
    half = min(int(np.searchsorted(np.cumsum(width[rising]), 90)), len(gap) - 1)
    return float((np.abs(gap - gap[rising[half]]) * width).sum())
