"""Test that the flat half of a painting consists of the pixels around which the target varies least."""

import math

import pytest
import torch
from brushexp_thesis.halves import BusyHalf, FlatHalf

from brushexp.plugins.metric.base import Comparison


def test_errors_count_in_the_half_in_which_they_are():
    target = torch.full((3, 32, 48), 0.5)
    target[:, :, 24:] += 0.4 * (torch.rand(3, 32, 24) - 0.5)
    painting = target.clone()
    painting[:, :, :16] += 0.1
    flat, busy = FlatHalf()(Comparison(painting, target)), BusyHalf()(Comparison(painting, target))
    assert flat == pytest.approx(-10 * math.log10(0.01 * 16 / 24), abs=1e-4)
    assert busy == math.inf or busy > 80
