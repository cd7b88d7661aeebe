"""Test that a person's corrections replace recovered strokes."""

from dataclasses import replace

import numpy as np
import pytest
from brushexp_recovery.curves.bezier import points_on
from brushexp_recovery.marks.corrections import check_marks, correct, fit_line
from brushexp_recovery.marks.marks_file import Mark, Marks
from brushexp_recovery.measure.stroke_table import tabulate_strokes
from brushexp_recovery.recover.storage import read_recovered
from brushexp_recovery.tasks import recover
from PIL import Image
from recovery_scenes import recover_dark

from brushexp.errors import UserError

SIZE = (60, 80)


def painting() -> np.ndarray:
    """Draw three dark horizontal strokes at y = 10, 30 and 50."""
    image = np.ones((*SIZE, 3), np.float32)
    for y in (10, 30, 50):
        image[y - 3 : y + 3, 20:60] = (0.2, 0.1, 0.0)
    return image


def level(y: float, left: float = 20, right: float = 60, by: str = "hand") -> Mark:
    """Make a horizontal mark 6 px wide."""
    return Mark(f"{y}", np.array([[left + 3, y], [right - 3, y]]), np.full(2, 6.0), (), by)


def marks_of(*strokes: Mark, deleted: tuple[Mark, ...] = ()) -> Marks:
    return Marks(list(strokes), list(deleted), SIZE, None, complete=False)


def test_deleted_strokes_go_marks_replace_them_and_the_rest_stays():
    image = painting()
    found = recover_dark(image, 0.6)
    found = replace(found, meetings=np.array([[0, 1], [1, 2], [0, 2]]), chance_above=np.array([0.9, 0.2, 0.7]))
    found = replace(found, ground=found.labels < 0)
    marks = marks_of(level(30, 20, 38), level(30, 42, 60), level(50, by="recovery"), deleted=(level(10),))
    corrected = correct(found, marks, image)
    table = tabulate_strokes(corrected)
    assert table.columns["y"] == pytest.approx([50, 30, 30], abs=0.5), "the recovered stroke lies below the marks"
    assert table.columns["confidence"] == pytest.approx([0.6, 1, 1])
    assert table.columns["length"] == pytest.approx([40, 18, 18], rel=0.1)
    assert table.columns["width"] == pytest.approx([6, 6, 6], rel=0.15)
    assert table.color[1:] == pytest.approx(np.tile([0.2, 0.1, 0.0], (2, 1)), abs=0.05)
    assert corrected.labels[10, 40] == corrected.labels[30, 40] == -1
    assert corrected.labels[50, 40] == 0
    assert corrected.ground[5, 5]
    assert not corrected.ground[corrected.labels >= 0].any()
    assert not len(corrected.meetings), "no pair of remaining strokes meets"


def test_meetings_of_strokes_that_stay_are_renumbered():
    image = painting()
    found = replace(recover_dark(image, 0.6), meetings=np.array([[0, 1], [1, 2]]), chance_above=np.array([0.9, 0.2]))
    corrected = correct(found, marks_of(deleted=(level(10),)), image)
    assert corrected.meetings.tolist() == [[0, 1]]
    assert corrected.chance_above.tolist() == [0.2]
    same = correct(found, marks_of(), image)
    np.testing.assert_array_equal(same.labels, found.labels)
    np.testing.assert_array_equal(same.meetings, found.meetings)
    np.testing.assert_allclose(same.saved.strokes.position, found.saved.strokes.position, atol=1e-3)


def test_a_curve_is_fitted_to_the_points_of_a_line():
    curve = np.array([[10.0, 10], [40, 50], [70, 10]])
    again = fit_line(points_on(curve[None], 30)[0])
    gap = np.linalg.norm(points_on(again[None], 50) - points_on(curve[None], 50), axis=-1)
    assert gap.max() < 1.5
    for points in ([[5.0, 5]], [[5.0, 5], [9, 9]]):
        straight = fit_line(np.array(points))
        assert straight[1] == pytest.approx(0.5 * (straight[0] + straight[2]))


def test_recover_takes_corrections(run_task, tmp_path, monkeypatch):
    monkeypatch.setattr(recover, "recover_with", lambda model, image, *rest: recover_dark(image, 0.6))
    Image.fromarray((255 * painting()).round().astype(np.uint8)).save(tmp_path / "a.png")
    path = tmp_path / "marks.json"
    path.write_text('{"size": [80, 60], "strokes": [{"points": [[5, 20], [75, 20]], "width": 4}]}')
    result = run_task(recover, "task=recover", f"image={tmp_path / 'a.png'}", f"marks={path}")
    assert result["n_strokes"] == 4
    assert read_recovered(tmp_path / "catalogue.h5").confidence.max() == 1
    path.write_text('{"size": [80, 61], "strokes": []}')
    with pytest.raises(UserError, match="to a picture of 80 x 61 pixels, but image= has 80 x 60"):
        check_marks(path, SIZE)
