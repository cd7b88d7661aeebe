"""Test that several paintings are tabulated with intervals, and that groups are compared with corrected p-values."""

import csv
import io
import json
from itertools import combinations

import numpy as np
import pandas as pd
import pytest
from brushexp_recovery.measure.measures import MEASURES
from brushexp_recovery.measure.several_paintings import (
    COMPARISON,
    least_p,
    paintings_of,
    permutation_p,
)


def runs_of(folder, lengths: dict[str, list[float]]) -> pd.DataFrame:
    """Write task=measure runs for several groups of paintings that differ only in stroke length."""
    rows = []
    for group, values in lengths.items():
        for number, length in enumerate(values):
            run = folder / f"{group}{number}"
            run.mkdir()
            figures = {name: {"unit": "", "value": 1.0, "low": 0.5, "high": 1.5} for name in MEASURES}
            figures["length"] |= {"unit": "px", "value": length, "low": length - 1, "high": length + 1}
            figures["curvature"] |= {"value": None, "low": None, "high": None}
            (run / "measures.json").write_text(json.dumps({"measures": {"whole": figures}}))
            rows.append({("run", "folder"): str(run), ("setting", "image"): f'"photos/{group}/{number}.jpg"'})
    frame = pd.DataFrame(rows)
    frame.columns = pd.MultiIndex.from_tuples(frame.columns)
    return frame


def read(path):
    return list(csv.DictReader(io.StringIO(path.read_text())))


def test_paintings_are_tabulated_and_their_groups_compared(tmp_path):
    frame = runs_of(tmp_path, {"early": [10, 11, 12, 13, 14], "late": [30, 31, 32, 33, 34], "alone": [20]})
    COMPARISON.write(tmp_path, frame)
    table = read(tmp_path / "paintings.csv")
    assert len(table) == 11 * len(MEASURES)
    assert {"painting": "0.jpg", "group": "early", "measure": MEASURES["length"].name, "unit": "px"}.items() <= (
        next(row for row in table if row["measure"] == MEASURES["length"].name).items()
    )
    assert "10 (9 to 11)" in (tmp_path / "paintings.md").read_text()
    groups = read(tmp_path / "groups.csv")
    length, *others = groups
    assert (length["measure"], length["first"], length["second"]) == (MEASURES["length"].name, "early (5)", "late (5)")
    assert float(length["p"]) == float(length["least p"]) == pytest.approx(2 / 252)
    assert all(float(row["p"]) == 1 and row["differ"] == "no" for row in others)
    assert MEASURES["direction"].name not in {row["measure"] for row in groups}
    assert MEASURES["curvature"].name not in {row["measure"] for row in groups}, "no painting has a value"
    page = COMPARISON.table(frame)
    assert page.rows[0]["p"] == "0.0079"


def test_other_sweeps_and_single_paintings_have_no_table(tmp_path):
    frame = runs_of(tmp_path, {"early": [10]})
    COMPARISON.write(tmp_path, frame)
    assert not (tmp_path / "paintings.csv").exists()
    assert COMPARISON.table(frame) is None
    assert paintings_of(frame.rename(columns={"image": "loss"}, level=1)) == []


def test_p_is_the_share_of_all_permutations_or_nearly_so():
    random = np.random.default_rng(0)
    first, second = random.normal(0, 1, 6), random.normal(1, 1, 5)
    both = np.concatenate([first, second])
    gaps = []
    for chosen in combinations(range(11), 6):
        rest = np.setdiff1d(np.arange(11), chosen)
        gaps.append(abs(both[list(chosen)].mean() - both[rest].mean()))
    exact = np.mean(np.array(gaps) >= abs(first.mean() - second.mean()) - 1e-12)
    assert permutation_p(first, second, random) == pytest.approx(exact)
    apart = np.arange(6.0), 10 + np.arange(5.0)
    assert permutation_p(*apart, random) == pytest.approx(least_p(6, 5)) == pytest.approx(1 / 462)
    many = random.normal(0, 1, 12), random.normal(0.7, 1, 12)
    p = permutation_p(*many, np.random.default_rng(1))
    assert p == pytest.approx(permutation_p(*many, np.random.default_rng(2)), abs=0.02)
