"""Correct p-values for multiple tests."""

from collections.abc import Sequence

import numpy as np


def holm(p_values: Sequence[float]) -> list[float]:
    """Correct the p-values of several tests to control the probability of any false positive.

    Source: Holm's step-down procedure (1979).

    >>> [round(p, 3) for p in holm([0.04, 0.001, 0.03])]
    [0.06, 0.003, 0.06]
    """
    order = np.argsort(p_values, kind="stable")
    rising = np.maximum.accumulate(np.array(p_values)[order] * np.arange(len(p_values), 0, -1))
    corrected = np.empty(len(p_values))
    corrected[order] = rising.clip(max=1)
    return corrected.tolist()
