"""Test that published speed and accuracy figures agree with their records, and that regrets are computed correctly."""

import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

ROOT = Path(__file__).parents[3]
sys.path.append(str(ROOT / "benchmarks"))
import speed_accuracy  # noqa: E402

RECORDS = ROOT / "docs" / "records" / "speed_accuracy.csv"


@pytest.fixture(scope="module")
def records():
    return pd.read_csv(RECORDS)


def test_the_table_of_the_page_is_made_of_the_records(capsys):
    speed_accuracy.show(RECORDS, None)
    lines = capsys.readouterr().out.splitlines()
    page = (ROOT / "docs" / "performance.md").read_text().splitlines()
    assert len(lines) > 20
    assert not [line for line in lines if line.startswith("|") and line not in page]


def test_every_picture_has_every_setting_of_the_experiment_once(records):
    settings = speed_accuracy.settings_of_experiment()
    for _, rows in records.groupby("picture"):
        assert sorted(rows["settings"]) == sorted(settings)
    assert set(records["picture"]) == set(speed_accuracy.PICTURES)


def test_a_regret_looks_only_at_settings_with_no_more_seconds_and_no_more_strokes():
    seconds = np.array([[1.0, 2.0, 2.0, 9.0]])
    strokes = np.array([[10.0, 10.0, 20.0, 10.0]])
    psnr = np.array([[25.0, 24.0, 30.0, 27.0]])
    assert speed_accuracy.regrets_of(seconds, strokes, psnr).tolist() == [[0.0, 1.0, 0.0, 0.0]]


def test_a_better_setting_is_named_by_its_mean_and_a_regret_is_one_of_each_picture():
    rows = [
        ("a", "steps=1", 1.0, 10, 20.0), ("a", "steps=2", 1.0, 10, 23.0), ("a", "steps=3", 1.0, 10, 21.0),
        ("b", "steps=1", 1.0, 10, 20.0), ("b", "steps=2", 1.0, 10, 18.0), ("b", "steps=3", 1.0, 10, 21.0),
    ]  # fmt: skip
    table = speed_accuracy.judge(pd.DataFrame(rows, columns=["picture", "settings", "cpu_seconds", "strokes", "psnr"]))
    assert table.loc["steps=1", ["regret", "gain"]].tolist() == pytest.approx([2.0, 1.0])
    assert table["instead"].to_dict() == {"steps=1": "steps=3", "steps=2": "steps=3", "steps=3": ""}
    low, regret, high = table.loc["steps=1", ["low", "regret", "high"]]
    assert (low, high) == pytest.approx((1.0, 3.0))
    assert low < regret < high


def test_presets_of_plain_lie_near_the_front(records):
    regrets = speed_accuracy.judge(records)["regret"]
    assert (regrets[list(speed_accuracy.PRESETS)] < 0.2).all()
    assert pd.read_csv(RECORDS.with_name("speed_regrets.csv")).set_index("settings")[
        "regret"
    ].to_dict() == pytest.approx(regrets.round(3).to_dict())


@pytest.mark.parametrize(("settings", "kind"), [
    ("quality=draft", "presets"),
    ("quality=draft density=adaptive", speed_accuracy.OTHERS),
    ("init=predicted steps=0", "predictor"),
    ("renderer=neural steps=9", "renderers"),
    ("density=worth_sketch", "strokes=auto"),
])  # fmt: skip
def test_the_figure_groups_settings(settings, kind):
    assert speed_accuracy.kind_of(settings) == kind
