"""Test that benchmark paintings are reproducible, that baselines find plain strokes, and that reports are written."""

import json

import numpy as np
import pytest
from brushexp_recovery.benchmark import report
from brushexp_recovery.benchmark.baselines import methods
from brushexp_recovery.benchmark.baselines.edges import is_brushstroke, longest_path
from brushexp_recovery.benchmark.baselines.methods import METHODS
from brushexp_recovery.benchmark.brushes import BRUSHES
from brushexp_recovery.benchmark.scenes import Scene, list_scenes, paint_scene
from brushexp_recovery.benchmark.score import score
from brushexp_recovery.benchmark.subjects import make_subject
from brushexp_recovery.benchmark.truth import Truth, draw_truth
from brushexp_recovery.confidence.calibration import ReliabilityBin
from recovery_scenes import straight

SIZE = (90, 120)


def clear_scene() -> tuple[Truth, np.ndarray]:
    """Draw strokes of different colours that do not touch each other."""
    curve = straight(*(((x - 12, y - 3), (x + 12, y + 3)) for y in range(12, 84, 20) for x in range(20, 110, 36)))
    color = np.random.default_rng(0).uniform(0, 0.6, (len(curve), 3))
    return draw_truth(curve, np.full(len(curve), 8.0), color, SIZE, np.ones(3))


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
    monkeypatch.setattr(methods, "DESCENT_STEPS", 2)
    _, image = clear_scene()
    assert len(METHODS["superpixels"](image, 30)) == pytest.approx(30, abs=8)
    prediction = METHODS["gradient"](image, 6)
    assert (len(prediction), prediction.labels.shape) == (6, SIZE)


def test_a_brushstroke_is_one_path_of_even_breadth():
    level = np.zeros((12, 40), bool)
    level[3:9, 2:38] = True
    assert is_brushstroke(level)
    cross = np.zeros((40, 40), bool)
    cross[17:23, 2:38], cross[2:38, 17:23] = True, True
    assert not is_brushstroke(cross)


def test_the_longest_path_of_a_skeleton_is_counted_in_steps():
    line = np.zeros((5, 9), bool)
    line[2, 1:8] = True
    assert longest_path(line) == 6
    line[3:, 4] = True  # a branch
    assert longest_path(line) == 6
    assert longest_path(np.eye(2, dtype=bool)) == 1
    assert longest_path(np.zeros((3, 3), bool)) == 0


@pytest.mark.parametrize("brush", BRUSHES)
def test_a_painting_is_decided_by_its_seed_and_its_truth_is_that_of_its_strokes(brush):
    painting, again = (paint_scene(Scene(brush, 10), 64, seed=3) for _ in range(2))
    np.testing.assert_array_equal(painting.clean, again.clean)
    np.testing.assert_array_equal(painting.hard, again.hard)
    truth = painting.truth
    assert 3 < truth.counts.sum() <= 10
    assert truth.share.max() <= 1
    lower, upper = truth.pairs.T
    assert (lower < upper).all()
    largest = truth.counts & (truth.share > 0.8)
    near = np.abs(truth.seen - truth.color)[largest].mean()
    assert near < 0.2  # visible parts have the colour of the paint
    assert 0 < np.abs(painting.hard - painting.clean).mean() < 0.28


def test_subjects_have_colours_and_scenes_have_names():
    subject = make_subject(64, np.random.default_rng(0))
    assert (subject.min() >= 0) & (subject.max() <= 1)
    assert subject.std((0, 1)).min() > 0.02
    assert [scene.name for scene in list_scenes(["dry"], [20], 2)] == ["dry-20", "dry-20-1"]
    assert not list_scenes(["fluid"], [5000], 1)


def test_reports_join_the_reliability_of_recovery(tmp_path, monkeypatch):
    place = {"scene": "a", "kind": "knife", "seen": False, "count": 3, "look": "hard", "method": "recovery", "f1": 0.5}
    rows = [
        place | {"seconds": 1.0, "reliability": [ReliabilityBin(0.5, 0.4, 5)]},
        place | {"seconds": 2.0, "reliability": [ReliabilityBin(0.5, 0.6, 5)]},
    ]
    rows += [place | {"look": "clean", "seconds": 1.0}]
    rows += [
        place
        | {"seen": True, "seconds": 1.0, "reliability": [ReliabilityBin(0.5, 0.2, 5), ReliabilityBin(0.9, 0.6, 15)]}
    ]
    monkeypatch.setattr(report, "draw_examples", lambda path, paintings, rows: path)
    report.write_report(tmp_path, rows)
    assert json.loads((tmp_path / "reliability.json").read_text())["unseen, hard"] == [[0.5, 0.5, 10]]
    summary = (tmp_path / "summary.md").read_text()
    assert "| recovery | – | 0.500 | 0.500 | 0.500 |" in summary
    for line in ("unseen, hard | 10 | 0.50 | 0.50 | 0.00", "seen, hard | 20 | 0.80 | 0.50 | 0.30"):
        assert f"| {line} |" in summary
    assert "| all, hard | 30 | 0.70 | 0.50 | 0.20 |" in summary  # 15 at 0.5, of which 0.4 are right, and 15 at 0.9
