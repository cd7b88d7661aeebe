"""Test that p-values and intervals of gains agree with SciPy in simple cases."""

import math

import numpy as np
import pandas as pd
import pytest
from brushexp_thesis.evidence import RARE, median_of, p_of_gains_and_losses, p_of_mean, p_of_ranks
from brushexp_thesis.study_records import rename_options
from scipy.stats import bootstrap, ttest_1samp, wilcoxon

GAINS = [0.3, -0.1, 0.4, 0.25, 0.6, 0.15, -0.02, 0.33]


def test_p_and_intervals_are_those_of_scipy_certain_without_spread():
    assert p_of_mean(GAINS, (0, math.inf)) == pytest.approx(ttest_1samp(GAINS, 0).pvalue)
    assert p_of_ranks(GAINS, (0, math.inf)) == pytest.approx(wilcoxon(GAINS).pvalue)
    assert p_of_mean(GAINS, (-math.inf, 0)) == p_of_ranks(GAINS, (-math.inf, 0)) == 1
    for p_of in (p_of_mean, p_of_ranks):
        assert p_of([0.0] * 6, (0, math.inf)) == 1
    assert p_of_mean([0.0] * 6, (-0.1, 0.1)) == p_of_mean([0.3] * 6, (0, math.inf)) == 0
    assert p_of_mean([0.3], (0, math.inf)) == 1
    gains = np.random.default_rng(1).normal(size=201).tolist()
    middle, low, high = median_of(gains, 0.95)
    expected = bootstrap((gains,), np.median, method="percentile", n_resamples=9999).confidence_interval
    assert middle == np.median(gains)
    assert (low, high) == pytest.approx((expected.low, expected.high), abs=0.05)
    assert median_of(gains, 0.95) == (middle, low, high)


@pytest.mark.parametrize("margin", [0.1, 0.4])
def test_p_of_equivalence_is_below_a_level_where_the_interval_is_within_the_margin(margin):
    p = p_of_mean(GAINS, (-margin, margin))
    low, high = ttest_1samp(GAINS, 0).confidence_interval(1 - p) if p < 1 else (-math.inf, math.inf)
    assert max(-low, high) == pytest.approx(margin) or (p == 1 and np.mean(GAINS) > margin)


@pytest.mark.parametrize(("gaining", "losing"), [(6, 4), (4, 6), (3, 0), (0, 0)])
def test_p_of_both_ways_is_twice_that_of_the_rarer_one(gaining, losing):
    gains = [1.0] * gaining + [-1.0] * losing + [0.05] * (12 - gaining - losing)
    rarer = min(gaining, losing)
    expected = sum(math.comb(12, k) * RARE**k * (1 - RARE) ** (12 - k) for k in range(rarer, 13))
    assert p_of_gains_and_losses(gains, 0.1) == pytest.approx(min(1, 2 * expected))


def test_settings_have_the_words_and_the_order_of_the_study():
    settings = ["init=even steps=800", "init=even init.orient=random steps=800", "init=even steps=50"]
    jobs = [["seed=0", f"image={name}", *setting.split()] for setting in settings for name in "ab"]
    labels = ["steps=800", "steps=800 init.orient=random", "steps=50"]
    index = pd.MultiIndex.from_product([labels, [*"ab"]], names=["option", "picture"])
    table = rename_options(pd.DataFrame({"psnr": range(6)}, index), jobs)
    assert [*table.index] == [(setting, name) for setting in settings for name in "ab"]
    assert table.index.names == index.names
    assert [*rename_options(table, []).index] == [*table.index]
