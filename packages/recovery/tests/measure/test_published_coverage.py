"""Test that the published coverage of the measures' intervals agrees with its record."""

import sys
from pathlib import Path

import pandas as pd
import pytest
from brushexp_recovery.measure.measures import MEASURES
from brushexp_recovery.measure.recovery_error import read_errors

ROOT = Path(__file__).parents[4]
sys.path.append(str(ROOT / "benchmarks"))
import coverage_of_measures as benchmark  # noqa: E402

RECORD = ROOT / "docs" / "records" / "measures.csv"


@pytest.fixture
def rows():
    return pd.read_csv(RECORD)


def test_the_table_of_the_page_is_made_of_the_record(rows):
    page = (ROOT / "docs" / "recovery_evidence.md").read_text(encoding="utf-8").splitlines()
    table = benchmark.table_of_paintings(rows)
    assert len(table) == 5
    assert [line for line in table if line not in page] == []


def test_no_painting_of_the_record_was_fitted_and_each_has_all_measures(rows):
    paintings = (rows["kind"] + "-" + rows["seed"].astype(str)).unique()
    assert set(paintings).isdisjoint(read_errors().paintings)
    assert len(rows) == len(paintings) * len(MEASURES)


def test_an_interval_holds_directions_across_the_turn():
    row = {"measure": "direction", "found": 175.0, "found_low": 165.0, "found_high": 185.0}
    rows = pd.DataFrame([row | {"true": 3.0}, row | {"true": 8.0}, row | {"true": 170.0}])
    assert benchmark.holds(rows, "found").tolist() == [True, False, True]
    lengths = pd.DataFrame([row | {"measure": "length", "true": true} for true in (164.0, 165.0, 3.0)])
    assert benchmark.holds(lengths, "found").tolist() == [False, True, False]
    assert benchmark.widths(lengths, "found").tolist() == pytest.approx([20 / 175] * 3)
    assert benchmark.widths(rows, "found").tolist() == [20] * 3
