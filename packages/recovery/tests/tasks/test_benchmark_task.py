"""Test that task=benchmark paints, finds and scores strokes, and that task=score gives the same scores."""

import csv
import io
import re

import pytest
from brushexp_recovery.tasks import benchmark, score

from brushexp.errors import UserError

WORDS = ("kinds=[knife]", "counts=[12]", "side=64")


def test_one_command_paints_looks_and_scores(run_task, tmp_path):
    result = run_task(benchmark, "experiment=recovery", *WORDS, "methods=[superpixels]")
    assert result["status"] == "completed"
    names = {path.name for path in tmp_path.iterdir()}
    assert names >= {"figures.csv", "summary.md", "summary.tex", "benchmark.png", "examples.png", "paintings"}
    rows = list(csv.DictReader(io.StringIO((tmp_path / "figures.csv").read_text())))
    assert [(row["look"], row["method"]) for row in rows] == [("clean", "superpixels"), ("hard", "superpixels")]
    strokes = tmp_path / "paintings" / "knife-12-superpixels.npz"
    result = run_task(score, "task=score", f"truth={tmp_path}/paintings/knife-12.npz", f"strokes={strokes}")
    assert result["f1"] == pytest.approx(float(rows[0]["f1"]), abs=1e-3)


def test_only_kinds_that_the_weights_have_not_learnt_from_are_painted(run_task, tmp_path, monkeypatch):
    monkeypatch.setattr(benchmark, "trained_families", lambda _: ("washes",))
    words = ("task=benchmark", "counts=[6]", "side=64", "hard=false", "unseen=true", "repeats=2")
    run_task(benchmark, *words, "kinds=[textured,washes,dabs]", "methods=[superpixels]")
    rows = list(csv.DictReader(io.StringIO((tmp_path / "figures.csv").read_text())))
    assert [(row["scene"], row["seen"]) for row in rows] == [("dabs-6", "False"), ("dabs-6-1", "False")]
    (line,) = [line for line in (tmp_path / "summary.md").read_text().splitlines() if "mean of kinds" in line]
    low, mean, high = (float(value) for value in re.search(r"([\d.]+) \(([\d.]+) to ([\d.]+)", line).group(2, 1, 3))
    assert low <= mean <= high


def test_strokes_of_others_are_scored_beside_methods(run_task, tmp_path):
    run_task(benchmark, "task=benchmark", *WORDS, "methods=[]", "hard=false")
    (tmp_path / "mine").mkdir()
    (tmp_path / "paintings" / "knife-12.npz").rename(tmp_path / "mine" / "knife-12.npz")
    words = ("methods=[]", "hard=false", f"add={tmp_path / 'mine'}")
    run_task(benchmark, "task=benchmark", *WORDS, *words)
    (row,) = csv.DictReader(io.StringIO((tmp_path / "figures.csv").read_text()))
    assert (row["method"], float(row["f1"])) == ("add", 1)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("kinds=[nope]",), "kinds has no 'nope'; choose from: textured"),
        (("kinds=[textured]", "unseen=true"), "was trained on all kinds"),
        (("methods=[nope]",), "methods has no 'nope'; choose from: recovery"),
        (("methods=[recovered_curves]", "weights=mine.safetensors"), r"mine\.safetensors"),
        (("methods=[]", "add=."), r"has no strokes for knife-12; write knife-12\.npz there"),
    ],
)
def test_what_cannot_be_run_is_refused(words, message, run_task, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(UserError, match=message):
        run_task(benchmark, "task=benchmark", *WORDS, *words)
