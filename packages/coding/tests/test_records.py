"""Test that the published tables of rate and distortion agree with the records."""

import sys
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).parents[3]
sys.path.append(str(ROOT / "benchmarks"))
import rate  # noqa: E402


def test_the_tables_of_the_page_are_made_of_the_records(capsys):
    rate.show(ROOT / "docs" / "records" / "rate.csv", None)
    lines = [line for line in capsys.readouterr().out.splitlines() if line.strip()]
    page = (ROOT / "docs" / "performance.md").read_text()
    assert len(lines) > 8
    assert not [line for line in lines if line not in page]


def test_a_curve_at_twice_the_rate_needs_twice_the_rate():
    half = [(0.1, 20.0), (0.4, 26.0), (1.0, 31.0)]
    twice = [(2 * bits, quality) for bits, quality in half]
    assert np.exp(rate.difference_of_rates(twice, half)) == pytest.approx(2)
    assert np.isnan(rate.difference_of_rates(half, [(1.0, 40.0), (2.0, 44.0)]))
    assert rate.quality_at(half, 0.4) == pytest.approx(26)
    assert np.isnan(rate.quality_at(half, 0.05))


def test_points_that_another_one_beats_are_left_out():
    row = {"set": "a", "picture": "b", "codec": "c"}
    points = [("0.5", "20"), ("0.2", "18"), ("0.6", "19")]
    rows = [row | {"bits_per_pixel": bits, "psnr": quality} for bits, quality in points]
    assert rate.curves(rows) == {("a", "b", "c"): [(0.2, 18.0), (0.5, 20.0)]}
