"""The benchmark: paintings by seed with their truth, baselines on plain scenes, one command, anybody's strokes."""

import csv
import io
import json

import numpy as np
import pytest
from brushexp_recovery import baselines, benchmark_task, score_task
from brushexp_recovery.baseline_edges import is_brushstroke, longest_way
from brushexp_recovery.baselines import METHODS
from brushexp_recovery.benchmark_report import write_report
from brushexp_recovery.benchmark_scenes import BRUSHES, Scene, paint, scenes_of, subject_of
from brushexp_recovery.score import score
from brushexp_recovery.truth import Truth, drawn_truth

from brushexp.errors import UserError

SIZE = (90, 120)


def clear_scene() -> tuple[Truth, np.ndarray]:
    """Strokes of different colours that do not touch."""
    x, y = np.meshgrid(np.arange(20, 110, 36), np.arange(12, 84, 20))
    middle = np.stack([x.ravel(), y.ravel()], 1).astype(float)
    way = np.array([12.0, 3.0])
    curve = np.stack([middle - way, middle, middle + way], 1)
    color = np.random.default_rng(0).uniform(0, 0.6, (len(middle), 3))
    return drawn_truth(curve, np.full(len(middle), 8.0), color, SIZE, np.ones(3))


@pytest.mark.parametrize("method", ["edges", "growing"])
def test_baselines_find_strokes_that_anybody_would_find(method):
    truth, image = clear_scene()
    figures = score(truth, METHODS[method](image, len(truth)))
    assert figures["recall"] == 1
    assert figures["precision"] > 0.9
    assert figures["direction_deg"] < 2
    assert figures["width_rel"] < 0.25
    assert figures["color_de00"] < 4


def test_superpixels_are_as_many_as_are_asked_for_and_gradient_descent_paints_with_the_number(monkeypatch):
    monkeypatch.setattr(baselines, "STEPS", 2)
    _, image = clear_scene()
    assert len(METHODS["superpixels"](image, 30)) == pytest.approx(30, abs=8)
    given = METHODS["gradient"](image, 6)
    assert (len(given), given.labels.shape) == (6, SIZE)


def test_a_brushstroke_is_one_way_of_even_breadth():
    level = np.zeros((12, 40), bool)
    level[3:9, 2:38] = True
    assert is_brushstroke(level)
    cross = np.zeros((40, 40), bool)
    cross[17:23, 2:38], cross[2:38, 17:23] = True, True
    assert not is_brushstroke(cross)
    line = np.zeros((5, 9), bool)
    line[2, 1:8] = True
    assert longest_way(line) == 6


@pytest.mark.parametrize("brush", BRUSHES)
def test_a_painting_is_decided_by_its_seed_and_its_truth_is_that_of_its_strokes(brush):
    painted, again = (paint(Scene(brush, 10), 64, seed=3) for _ in range(2))
    np.testing.assert_array_equal(painted.clean, again.clean)
    np.testing.assert_array_equal(painted.hard, again.hard)
    truth = painted.truth
    assert 3 < truth.counts.sum() <= 10
    assert truth.share.max() <= 1
    lower, upper = truth.pairs.T
    assert (lower < upper).all()
    largest = truth.counts & (truth.share > 0.8)
    near = np.abs(truth.seen - truth.color)[largest].mean()
    assert near < 0.2  # what is seen of a stroke has the colour of its paint
    assert 0 < np.abs(painted.hard - painted.clean).mean() < 0.28


def test_subjects_have_colours_and_scenes_have_names():
    subject = subject_of(64, np.random.default_rng(0))
    assert (subject.min() >= 0) & (subject.max() <= 1)
    assert subject.std((0, 1)).min() > 0.02
    assert [scene.name for scene in scenes_of(["dry"], [20], 2)] == ["dry-20", "dry-20-1"]
    assert not scenes_of(["fluid"], [5000], 1)


def test_one_command_paints_looks_and_scores(run_task, tmp_path):
    words = ("kinds=[knife]", "counts=[12]", "side=64", "methods=[superpixels]")
    result = run_task(benchmark_task, "experiment=recovery", *words)
    assert result["status"] == "completed"
    names = {path.name for path in tmp_path.iterdir()}
    assert names >= {"figures.csv", "summary.md", "summary.tex", "benchmark.png", "examples.png", "paintings"}
    rows = list(csv.DictReader(io.StringIO((tmp_path / "figures.csv").read_text())))
    assert [(row["look"], row["method"]) for row in rows] == [("clean", "superpixels"), ("hard", "superpixels")]
    strokes = tmp_path / "paintings" / "knife-12-superpixels.npz"
    result = run_task(score_task, "task=score", f"truth={tmp_path}/paintings/knife-12.npz", f"strokes={strokes}")
    assert result["f1"] == pytest.approx(float(rows[0]["f1"]), abs=1e-3)
    with pytest.raises(UserError, match="methods has no 'nope'; choose from: recovery"):
        run_task(benchmark_task, "task=benchmark", "methods=[nope]")
    with pytest.raises(UserError, match=r"mine\.safetensors"):
        run_task(benchmark_task, "task=benchmark", *words, "methods=[recovered_curves]", "weights=mine.safetensors")
    with pytest.raises(UserError, match=r"has no strokes of knife-12; write knife-12\.npz there"):
        run_task(benchmark_task, "task=benchmark", *words, f"add={tmp_path / 'paintings' / '..'}")


def test_reports_join_the_reliability_of_recovery(tmp_path):
    (tmp_path / "paintings").mkdir()
    place = {"scene": "a", "kind": "knife", "seen": False, "count": 3, "look": "hard", "method": "recovery", "f1": 0.5}
    rows = [
        place | {"seconds": 1.0, "reliability": [(0.5, 0.4, 5)]},
        place | {"seconds": 2.0, "reliability": [(0.5, 0.6, 5)]},
    ]
    rows += [place | {"look": "clean", "seconds": 1.0}]
    rows += [place | {"seen": True, "seconds": 1.0, "reliability": [(0.5, 0.2, 5), (0.9, 0.6, 15)]}]
    from brushexp_recovery import benchmark_report  # noqa: PLC0415

    pytest.MonkeyPatch().setattr(benchmark_report, "draw_examples", lambda folder, rows: [])
    write_report(tmp_path, rows)
    assert json.loads((tmp_path / "reliability.json").read_text())["unseen, hard"] == [[0.5, 0.5, 10]]
    summary = (tmp_path / "summary.md").read_text()
    assert "| recovery | – | 0.500 | 0.500 | 0.500 |" in summary
    for line in ("unseen, hard | 10 | 0.50 | 0.50 | 0.00", "seen, hard | 20 | 0.80 | 0.50 | 0.30"):
        assert f"| {line} |" in summary
    assert "| all, hard | 30 | 0.70 | 0.50 | 0.20 |" in summary  # 15 at 0.5 of which 0.4 are right, and 15 at 0.9
