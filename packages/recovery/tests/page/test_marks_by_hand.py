"""Test that strokes can be corrected on the page by mouse and by keyboard, and saved as marks."""

import numpy as np
import pytest
from brushexp_recovery.marks.mark_regions import pixels_of_mark
from brushexp_recovery.marks.marks_file import Marks, read_marks
from brushexp_recovery.measure.stroke_table import StrokeTable, tabulate_strokes
from brushexp_recovery.page.stroke_page import write_page
from recovery_scenes import recover_dark

SIZE = (60, 80)


def dark_strokes() -> tuple[StrokeTable, np.ndarray]:
    """Draw dark horizontal strokes 6 px wide: one at y = 10 and two at y = 30, with a gap from x = 36 to 44."""
    image = np.ones((*SIZE, 3))
    for top, left, right in ((7, 20, 60), (27, 10, 36), (27, 44, 70)):
        image[top : top + 6, left:right] = 0
    return tabulate_strokes(recover_dark(image, 0.8)), (255 * image).astype(np.uint8)


class Editor:
    """The stroke editor of a page in a browser, controlled in pixel coordinates of the picture."""

    def __init__(self, watched, folder):
        self.page, self.folder = watched.page, folder
        self.page.locator("#count", has_text="3 of 3").wait_for()
        self.page.locator("#look-at").scroll_into_view_if_needed()

    def at(self, x: float, y: float) -> tuple[float, float]:
        box = self.page.locator("#canvas").bounding_box()
        return box["x"] + box["width"] * x / SIZE[1], box["y"] + box["height"] * y / SIZE[0]

    def choose(self, tool: str) -> None:
        self.page.locator(f"[data-tool={tool}]").click()
        self.page.locator("#look-at").scroll_into_view_if_needed()

    def do(self, action: str) -> None:
        self.page.locator(f"[data-marks={action}]").click()
        self.page.locator("#look-at").scroll_into_view_if_needed()

    def tap(self, x: float, y: float) -> None:
        self.page.mouse.click(*self.at(x, y))

    def drag(self, *places: tuple[float, float]) -> None:
        self.page.mouse.move(*self.at(*places[0]))
        self.page.mouse.down()
        for place in places[1:]:
            self.page.mouse.move(*self.at(*place), steps=5)
        self.page.mouse.up()

    def saved(self) -> Marks:
        with self.page.expect_download() as download:
            self.do("save")
        download.value.save_as(self.folder / "marks.json")
        return read_marks(self.folder / "marks.json")


def mask_of(marks: Marks, number: int) -> np.ndarray:
    mask = np.zeros(SIZE, bool)
    mask.flat[pixels_of_mark(marks.strokes[number], SIZE)] = True
    return mask


@pytest.mark.parametrize("width", [390, 1280])
def test_strokes_are_added_deleted_split_and_joined_by_mouse(width, opened, tmp_path):
    table, image = dark_strokes()
    watched = opened(write_page(tmp_path, image, table, "x.jpg"), (width, 900))
    editor = Editor(watched, tmp_path)
    editor.choose("add")
    editor.page.locator("#mark-width").fill("8")
    editor.drag((20, 50), (40, 50), (60, 50))
    editor.choose("delete")
    editor.tap(40, 50)
    editor.do("undo")
    editor.choose("split")
    editor.drag((40, 2), (40, 18))
    editor.choose("join")
    editor.tap(20, 30)
    editor.tap(60, 30)
    marks = editor.saved()
    assert marks.size == SIZE
    assert sorted(mark.by for mark in marks.strokes) == ["hand"] * 4
    assert len(marks.deleted) == 3
    masks = [mask_of(marks, number) for number in range(4)]
    areas = [mask.sum() for mask in masks]
    assert areas[:2] == pytest.approx([120, 120], rel=0.15), "halves of a stroke of 240 pixels"
    assert masks[0][10, 25] != masks[1][10, 25]
    assert masks[2][50, 40]
    assert areas[2] == pytest.approx(40 * 8 + np.pi * 16, rel=0.1)
    assert areas[3] == pytest.approx(2 * 26 * 6, rel=0.1), "both parts without the gap"
    assert masks[3][30, [20, 40, 60]].tolist() == [True, False, True]
    editor.do("empty")
    assert not editor.saved().strokes
    editor.page.locator("#mark-file").set_input_files(tmp_path / "marks.json")
    assert not watched.is_too_wide()
    assert not watched.errors


def test_a_keyboard_does_the_same_and_a_file_is_opened_again(opened, tmp_path):
    table, image = dark_strokes()
    watched = opened(write_page(tmp_path, image, table, "x.jpg"), (1280, 900))
    editor = Editor(watched, tmp_path)
    stage = editor.page.locator("#look-at")
    for key in ("+",) * 6:
        stage.press(key)
    for key in ("a", "Enter", "ArrowRight", "ArrowRight", "ArrowDown", "Enter", "Enter"):  # the middle is bare
        stage.press(key)
    editor.page.locator("#mark-count", has_text="4 strokes, 1 by hand").wait_for()
    stage.press("d")
    stage.press("Enter")  # the cross is on the end of the stroke
    editor.page.locator("#mark-count", has_text="3 strokes, 0 by hand").wait_for()
    stage.press("u")
    editor.page.locator("#mark-count", has_text="4 strokes, 1 by hand").wait_for()
    before = editor.saved()
    assert [mark.by for mark in before.strokes] == ["recovery"] * 3 + ["hand"]
    stage.press("s")
    for key in ("ArrowLeft", "ArrowUp", "ArrowUp", "Enter", "ArrowDown", "ArrowDown", "ArrowDown", "Enter"):
        stage.press(key)
    editor.page.locator("#mark-count", has_text="5 strokes, 2 by hand").wait_for()
    editor.do("empty")
    editor.page.locator("#mark-file").set_input_files(tmp_path / "marks.json")
    editor.page.locator("#mark-count", has_text="4 strokes, 1 by hand").wait_for()
    again = editor.saved()
    for one, other in zip(before.strokes, again.strokes, strict=True):
        np.testing.assert_array_equal(one.points, other.points)
    (tmp_path / "no.json").write_text("[]")
    editor.page.locator("#mark-file").set_input_files(tmp_path / "no.json")
    editor.page.locator("#mark-count", has_text="no.json has no marks").wait_for()
    assert not watched.errors
