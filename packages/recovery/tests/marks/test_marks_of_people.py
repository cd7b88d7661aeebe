"""Test that hand-drawn marks are read from files, converted to regions, and compared with strokes."""

import csv
import io
import json

import numpy as np
import pytest
from brushexp_recovery.marks.mark_regions import overlaps_of_pixels, pixels_of_mark
from brushexp_recovery.marks.mark_score import Counts, State, compare_regions, figures_of, judged_strokes
from brushexp_recovery.marks.marks_file import Mark, Marks, is_marks, read_marks
from brushexp_recovery.raster.labels import group_pixels
from brushexp_recovery.raster.overlap import overlaps_between
from brushexp_recovery.tasks import score
from PIL import Image

from brushexp.errors import UserError

SIZE = (40, 60)


def level(y: float, width: float = 6.0, left: float = 10, right: float = 50) -> dict[str, object]:
    """Make a horizontal mark in the format of a marks file."""
    return {"points": [[left, y], [right, y]], "width": width}


def write_marks(path, *strokes, **values):
    path.write_text(json.dumps({"strokes": strokes, "size": SIZE[::-1], **values}))
    return path


def rows_of(*marks: tuple[int, int]) -> list[np.ndarray]:
    """Make regions of whole rows, one for each pair of top and bottom."""
    return [np.arange(top * SIZE[1], bottom * SIZE[1]) for top, bottom in marks]


def test_a_mark_covers_what_discs_along_it_cover():
    points, width = np.array([[10.0, 8], [30, 20], [50, 18]]), np.array([4.0, 12, 6])
    y, x = np.mgrid[: SIZE[0], : SIZE[1]] + 0.5
    mask = np.zeros(SIZE, bool)
    for k in (0, 1):
        for share in np.linspace(0, 1, 400):
            centre, radius = ((1 - share) * a[k] + share * a[k + 1] for a in (points, width / 2))
            mask |= (x - centre[0]) ** 2 + (y - centre[1]) ** 2 <= radius**2
    pixels = pixels_of_mark(Mark("a", points, width), SIZE)
    assert len(np.setxor1d(pixels, np.flatnonzero(mask))) < 0.03 * mask.sum()
    assert (np.diff(pixels) > 0).all()
    assert not len(pixels_of_mark(Mark("beyond", points + 500, width), SIZE))
    square = np.array([[10.0, 10], [20, 10], [20, 15], [10, 15]])
    assert len(pixels_of_mark(Mark("b", points, width, (square, square + np.array([0, 2]))), SIZE)) == 70


def test_regions_of_labels_overlap_as_label_images_do():
    random = np.random.default_rng(0)
    first, second = (random.integers(-1, 9, SIZE).repeat(3, 0).astype(np.int32) for _ in range(2))
    expected = overlaps_between(first, second, 9, 9)
    shared = overlaps_of_pixels(group_pixels(first, 9), group_pixels(second, 9), first.size)
    order = np.lexsort((shared.second, shared.first))
    for one, other in zip(shared, expected, strict=True):
        np.testing.assert_allclose(one[order], other)
    assert not len(overlaps_of_pixels([], group_pixels(second, 9), first.size).iou)


def test_what_is_found_missed_extra_and_not_judged():
    marks = rows_of((2, 6), (10, 14), (20, 24))
    strokes = rows_of((2, 6), (10, 12), (12, 14), (30, 34))  # one is found, one is split, one lies off the marks
    known = Marks([], [], SIZE, None, complete=False)
    judged = judged_strokes(known, marks, strokes, SIZE)
    agreement = compare_regions(marks, strokes, judged, SIZE[0] * SIZE[1])
    assert agreement.best_iou == pytest.approx([1, 0.5, 0])
    hard = agreement.scores[""]
    assert hard.marks == [State.FOUND, State.FOUND, State.MISSED]
    assert sorted(hard.strokes) == [State.EXTRA, State.FOUND, State.FOUND, State.UNJUDGED]
    everywhere = Marks([], [], SIZE, None, complete=True)
    assert judged_strokes(everywhere, marks, strokes, SIZE).tolist() == [True] * 4
    below = Marks([], [], SIZE, None, complete=(0, 25, 60, 15))
    assert judged_strokes(below, [], strokes, SIZE).tolist() == [False, False, False, True]


def test_intervals_are_those_of_strokes_drawn_with_replacement():
    counts = Counts(found=30, missed=20, extra=10)
    figures = figures_of(counts, "", 0)
    assert figures["recall"] == pytest.approx(0.6)
    assert figures["precision"] == pytest.approx(0.75)
    assert figures["f1"] == pytest.approx(2 / 3)
    random = np.random.default_rng(1)
    kinds = np.repeat([0, 1, 2], [30, 20, 10])
    draws = [np.bincount(random.choice(kinds, 60), minlength=3) for _ in range(2000)]
    low, high = np.quantile([found / (found + missed) for found, missed, _ in draws], (0.025, 0.975))
    assert figures["recall_low"] == pytest.approx(low, abs=0.02)
    assert figures["recall_high"] == pytest.approx(high, abs=0.02)
    assert np.isnan(figures_of(Counts(0, 0, 0), "", 0)["f1_low"])


def test_strokes_are_scored_against_marks_with_a_page(run_task, tmp_path, opened):
    write_marks(tmp_path / "a.json", level(10), level(20), level(30), image="a.png", complete=True)
    Image.fromarray(np.full((*SIZE, 3), 200, np.uint8)).save(tmp_path / "a.png")
    labels = np.zeros((*SIZE, 3), np.uint8)
    labels[7:13, 8:52], labels[34:40, 10:50] = 50, 100  # one mark is found, one stroke is extra
    Image.fromarray(labels).save(tmp_path / "mine.png")
    result = run_task(score, "task=score", f"truth={tmp_path / 'a.json'}", f"strokes={tmp_path / 'mine.png'}")
    assert result["recall"] == pytest.approx(1 / 3)
    assert result["precision"] == pytest.approx(1 / 2)
    assert result["recall_low"] < 1 / 3 < result["recall_high"]
    rows = list(csv.DictReader(io.StringIO((tmp_path / "a.csv").read_text())))
    assert [row["at_5"] for row in rows] == ["found", "missed", "missed"]
    for width in (390, 1280):
        watched = opened(tmp_path / "a.html", (width, 800))
        counts = [watched.page.locator(f"svg .{layer} path").count() for layer in ("found", "missed", "extra")]
        assert counts == [1, 2, 1]
        assert not watched.is_too_wide()
        watched.page.locator(".missed-chip").click()
        assert not watched.page.locator("svg .missed").is_visible()
        assert not watched.errors


def test_two_people_are_compared_over_folders(run_task, tmp_path):
    for person, second in (("one", 20), ("two", 33)):
        (tmp_path / person).mkdir()
        for name in ("a", "b"):
            write_marks(tmp_path / person / f"{name}.json", level(10), level(second))
    result = run_task(score, "task=score", f"truth={tmp_path / 'one'}", f"strokes={tmp_path / 'two'}")
    assert result["between"] == "people"
    assert (result["f1"], result["truth"], result["predicted"]) == (pytest.approx(0.5), 4, 4)
    rows = list(csv.DictReader(io.StringIO((tmp_path / "scores.csv").read_text())))
    assert [row["picture"] for row in rows] == ["a", "b", "all"]
    (tmp_path / "two" / "b.json").unlink()
    with pytest.raises(UserError, match=r"has no strokes for b; write b\.json"):
        run_task(score, "task=score", f"truth={tmp_path / 'one'}", f"strokes={tmp_path / 'two'}")


@pytest.mark.parametrize(
    ("strokes", "values", "message"),
    [
        ([{"points": [[1, 2]], "width": 0}], {}, "width of stroke 1 must be one number above 0"),
        ([{"points": [[1]], "width": 3}], {}, r"points of stroke 1 must be at least 1 pairs \[x, y\]"),
        ([{"points": [[1, 2], [3, 4]], "width": [1, 2, 3]}], {}, "or one for each of its 2 points"),
        ([{"points": [[1, float("nan")]], "width": 3}], {}, "must be finite and within 1000000 pixels"),
        ([level(9)], {"version": 2}, "has format_version 2, and this brushexp reads 1; update brushexp"),
        (["x"], {}, "stroke 1 is str, not a stroke with points and width"),
        ([level(1)], {"size": [0, 5]}, "size must be the width and the height"),
        ([level(1)], {"complete": [1, 2]}, "complete must be true, false or"),
        ([level(1) | {"outlines": [[[1, 2], [3, 4]]]}], {}, "outlines of stroke 1 must be at least 3 pairs"),
    ],
)
def test_what_is_wrong_with_a_file_of_marks_is_said(strokes, values, message, tmp_path):
    path = write_marks(tmp_path / "a.json", *strokes, **values)
    with pytest.raises(UserError, match=message):
        read_marks(path)


def test_the_size_of_a_photograph_that_lies_on_its_side_is_that_of_the_upright_picture(run_task, tmp_path):
    turned = Image.Exif()
    turned[0x0112] = 6  # orientation: a quarter turn
    Image.new("RGB", SIZE, "white").save(tmp_path / "photo.jpg", exif=turned)  # 40 wide as stored, 60 wide upright
    truth = write_marks(tmp_path / "photo.json", level(10), size=None)
    np.save(tmp_path / "labels.npy", np.full(SIZE, -1, np.int32))
    result = run_task(score, "task=score", f"truth={truth}", f"strokes={tmp_path / 'labels.npy'}")
    assert (result["truth"], result["recall"]) == (1, 0)


def test_other_files_are_no_marks(tmp_path):
    for name, text in (("a.json", '{"format": "brushexp catalogue"}'), ("b.json", "[1]"), ("c.txt", "{}")):
        (tmp_path / name).write_text(text)
        assert not is_marks(tmp_path / name)
    with pytest.raises(UserError, match="strokes and deleted must be lists"):
        read_marks(tmp_path / "b.json")
    assert is_marks(write_marks(tmp_path / "d.json", format="brushexp marks"))
    assert read_marks(tmp_path / "d.json").strokes == []
