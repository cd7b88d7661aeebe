"""Tests that Holm-corrected p-values reject exactly the hypotheses that the stepwise procedure rejects."""

import numpy as np
import pytest

from brushexp.contracts.results import holm


def test_corrected_p_values_are_those_worked_by_hand():
    assert holm([0.04, 0.001, 0.03]) == pytest.approx([0.06, 0.003, 0.06])
    assert holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])
    assert holm([0.5, 0.9]) == [1, 1]
    assert holm([]) == []


def test_a_corrected_p_value_is_small_where_the_stepwise_test_rejects():
    random = np.random.default_rng(0)
    for _ in range(20):
        p = random.random(6) ** 3
        corrected = np.array(holm(p.tolist()))
        rejected = np.zeros(6, bool)
        for step, k in enumerate(np.argsort(p)):
            if p[k] > 0.1 / (6 - step):
                break
            rejected[k] = True
        assert (corrected <= 0.1).tolist() == rejected.tolist()
