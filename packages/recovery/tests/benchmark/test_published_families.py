"""Test that the published comparison of families left out and included agrees with its record."""

import sys
from pathlib import Path

import pandas as pd
import pytest
from brushexp_recovery.synthesis.families.family import find_families

ROOT = Path(__file__).parents[4]
sys.path.append(str(ROOT / "benchmarks"))
import recovery_families as benchmark  # noqa: E402

RECORD = ROOT / "docs" / "records" / "recovery_families.csv"


def test_the_table_of_the_page_is_made_of_the_record_which_covers_all_families():
    record = pd.read_csv(RECORD)
    page = (ROOT / "docs" / "recovery_evidence.md").read_text(encoding="utf-8")
    assert "\n".join(benchmark.table_of(record)) in page
    assert set(record["kind"]) == set(find_families())


def test_gains_are_paired_and_a_painting_that_both_halves_have_seen_is_refused():
    rows = [
        {"scene": scene, "kind": "dabs", "look": "clean", "seen": seen, "f1": f1, "weights": weights}
        for scene, values in {"a": (0.2, 0.5, 0.9), "b": (0.6, 0.7, 0.8)}.items()
        for seen, f1, weights in zip((False, True, True), values, ("half", "half", "shipped"), strict=True)
    ]
    table = benchmark.compare(pd.DataFrame(rows))
    assert table["gain"].tolist() == pytest.approx([0.3, 0.1])
    assert table["shipped"].tolist() == [0.9, 0.8]
    with pytest.raises(ValueError, match="not seen by exactly one half"):
        benchmark.compare(pd.DataFrame(rows).assign(seen=True).drop_duplicates(["scene", "weights"]))
