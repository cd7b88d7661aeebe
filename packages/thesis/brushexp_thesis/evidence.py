"""Complement the Student's t interval of mean paired gains with rank tests, medians and the power of a study.

``gains`` has one value for each picture or seed; see `brushexp_studies.paired.Difference`.
"""

import math
from collections.abc import Sequence

import numpy as np
from brushexp_studies.paired import Difference
from scipy.stats import binom, t, wilcoxon

Bounds = tuple[float, float]  # bounds of a mean gain; infinite where a statement sets no bound
RESAMPLES = 9999
POWER = 0.8  # share of studies that find the smallest detectable effect
RARE = 0.05  # an answer depends on the picture if more than this share of all pictures gain, and more than it lose


def p_of_mean(gains: Sequence[float], stated: Bounds) -> float:
    """Compute the two-sided p-value of Student's t-test for the hypothesis that the mean gain is within bounds.

    The result is twice the larger of the one-sided p-values for the two bounds; with two finite bounds, this is an
    equivalence test (Schuirmann, 1987). If it is above 0.05, the 95 % confidence interval extends beyond the bounds.
    """
    sample = np.array(gains, float)
    if len(sample) < 2:
        return 1.0
    error = sample.std(ddof=1) / math.sqrt(len(sample))
    distances = [sample.mean() - stated[0], stated[1] - sample.mean()]
    ratios = [distance / error if error else math.inf * (1 if distance > 0 else -1) for distance in distances]
    return min(1.0, 2 * max(float(t.sf(ratio, len(sample) - 1)) for ratio in ratios))


def p_of_ranks(gains: Sequence[float], stated: Bounds) -> float:
    """Compute the p-value of the signed-rank test (Wilcoxon, 1945) for the same hypothesis as in `p_of_mean`."""
    sample = np.array(gains, float)
    above = [sign * (sample - bound) for sign, bound in zip((1, -1), stated, strict=True) if math.isfinite(bound)]
    one_sided = [float(wilcoxon(one, alternative="greater").pvalue) if one.any() else 1.0 for one in above]
    return min(1.0, 2 * max(one_sided, default=0.0))


def p_of_gains_and_losses(gains: Sequence[float], matters: float) -> float:
    """Compute the p-value for the hypothesis that more than 5 % (`RARE`) of all pictures gain and more than 5 % lose.

    Only gains and losses greater than ``matters`` count. The result is twice the larger of the two binomial p-values
    (an intersection-union test; Berger, 1982).
    """
    sample = np.array(gains, float)
    counts = [int((sign * sample > matters).sum()) for sign in (1, -1)]
    return min(1.0, 2 * max(float(binom.sf(count - 1, len(sample), RARE)) for count in counts))


def median_of(gains: Sequence[float], confidence: float) -> tuple[float, float, float]:
    """Compute the median and its bootstrap percentile interval (Efron, 1979), with a fixed seed."""
    sample = np.array(gains, float)
    drawn = np.random.default_rng(0).choice(sample, (RESAMPLES, len(sample)))
    low, high = np.quantile(np.median(drawn, axis=1), [(1 - confidence) / 2, (1 + confidence) / 2])
    return float(np.median(sample)), float(low), float(high)


def detectable_effect(one: Difference) -> float:
    """Compute the smallest mean gain that a study of this size and spread detects with probability `POWER`.

    A gain is detected if its interval excludes zero. The result is half the interval's width plus the `POWER` quantile
    of Student's t times the standard error (Bloom, 1995).
    """
    n_units = len(one.gains)
    if n_units < 2:
        return math.inf
    error = np.std(list(one.gains.values()), ddof=1) / math.sqrt(n_units)
    return float(one.high - one.mean + t.ppf(POWER, n_units - 1) * error)
