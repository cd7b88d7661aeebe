"""Test that the stroke page and its files hold the strokes' measures, and that the page works in a browser."""

import csv
import io
import json
from dataclasses import replace

import numpy as np
import pytest
from brushexp_recovery.benchmark.truth import draw_truth
from brushexp_recovery.measure.draws import draw_figures, sight
from brushexp_recovery.measure.figure_tables import figure_rows, format_number
from brushexp_recovery.measure.files import write_measures
from brushexp_recovery.measure.intervals import intervals_of
from brushexp_recovery.measure.stroke_table import StrokeTable, columns_with_units, remark_on, tabulate_strokes
from brushexp_recovery.measure.views import View
from brushexp_recovery.page.stroke_page import page_of, write_page
from brushexp_recovery.recover.storage import Recovered
from recovery_scenes import saved_strokes

SIZE = (60, 80)
CONFIDENCE = np.array([0.2, 0.6, 0.9], np.float32)


def recovered() -> tuple[Recovered, np.ndarray]:
    """Make a horizontal, a descending and a vertical stroke, with the top stroke first in the catalogue."""
    middle = np.array([[20.0, 10], [40, 30], [65, 30]])
    turn = np.radians([0.0, 45, 90])
    way = np.array([14.0, 10, 18])[:, None] * np.stack([np.cos(turn), np.sin(turn)], 1)
    curve = np.stack([middle - way, middle, middle + way], 1)
    truth, image = draw_truth(curve, np.array([6.0, 5, 8]), np.eye(3), SIZE, np.ones(3))
    saved = saved_strokes(curve[::-1], truth.width[::-1], truth.color[::-1], SIZE, depth=[2, 1, 0])
    labels = np.where(truth.labels >= 0, 2 - truth.labels, -1)
    return Recovered(saved, CONFIDENCE[::-1], labels), image


def table_and_image(mm: float | None = 0.5) -> tuple[StrokeTable, np.ndarray]:
    found, image = recovered()
    return tabulate_strokes(found, mm), (255 * image).astype(np.uint8)


def test_rows_are_the_strokes_from_the_bottom_up_with_units():
    table, _ = table_and_image()
    columns = table.columns
    assert columns["stroke"].tolist() == [2, 1, 0]
    assert columns["confidence"] == pytest.approx(CONFIDENCE)
    assert columns["direction"] == pytest.approx([0, 45, 90], abs=0.01)  # clockwise: y points down
    assert columns["length"] == pytest.approx([28 + 6, 20 + 5, 36 + 8], rel=1e-3)  # the curve plus one width
    named = columns_with_units(table)
    assert named["length [mm]"] == pytest.approx([17, 12.5, 22], rel=1e-3)
    assert named["area [mm^2]"] == pytest.approx(columns["area"] / 4)
    assert "direction [deg clockwise]" in named
    for outline, x, y in zip(table.outlines, columns["x"], columns["y"], strict=True):
        assert 0.5 * (outline.min(0) + outline.max(0)) == pytest.approx([x, y], abs=1)
    assert "length [mm]" not in columns_with_units(table_and_image(None)[0])


def test_files_hold_the_figures(tmp_path):
    pytest.importorskip("openpyxl")
    import pandas as pd  # noqa: PLC0415

    found, image = recovered()
    seen = [sight(image, View(), lambda _: found)]
    figures = {"whole": intervals_of(draw_figures(seen, {"whole": np.ones(SIZE, bool)}, 30, 0)["whole"], 0.5)}
    table = tabulate_strokes(found, 0.5)
    paths = write_measures(tmp_path, table, figures, figures["whole"], 0.5)
    assert {path.name for path in paths} >= {"measures.xlsx", "measures.pdf", "measures.tex", "strokes.csv"}
    lines = list(csv.DictReader(io.StringIO((tmp_path / "strokes.csv").read_text())))
    assert [float(line["width [mm]"]) for line in lines] == pytest.approx([3, 2.5, 4])
    sheets = pd.read_excel(tmp_path / "measures.xlsx", sheet_name=None)
    assert set(sheets) == {"measures", "differences", "strokes"}
    assert sheets["strokes"]["length [px]"].tolist() == pytest.approx([34, 25, 44], rel=1e-3)
    data = json.loads((tmp_path / "measures.json").read_text())
    assert data["measures"]["whole"]["length"]["unit"] == "mm"
    assert data["mm_per_px"] == 0.5
    assert (tmp_path / "measures.pdf").read_bytes().startswith(b"%PDF")
    assert r"\toprule" in (tmp_path / "measures.tex").read_text()
    page = write_page(
        tmp_path, (255 * image).astype(np.uint8), table, "x.jpg", tables={"Measures": figure_rows(figures, 0.5)}
    )
    for name in ("measures.pdf", "measures.xlsx", "measures.tex", "strokes.csv"):
        assert f'href="{name}"' in page.read_text()


def test_names_are_escaped_and_nothing_is_asked_of_other_places():
    table, image = table_and_image(None)
    html = page_of(image, table, "<b>x</b>")
    assert "<b>x" not in html
    assert "45° falls to the right" in html
    assert "http" not in html.replace("http://www.w3.org", "").replace("http-equiv", "")


def test_a_page_shows_at_least_half_of_the_strokes_at_first(opened, tmp_path):
    table, image = table_and_image()
    unsure = replace(table, columns={**table.columns, "confidence": np.array([0.1, 0.22, 0.3])})
    page = opened(write_page(tmp_path, image, unsure, "x.jpg")).page
    page.locator("#count", has_text="2 of 3 recovered strokes have a confidence of 0.20 or more").wait_for()


def test_a_visitor_chooses_strokes_picks_one_and_exports_what_is_shown(opened, tmp_path):
    table, image = table_and_image()
    watched = opened(write_page(tmp_path, image, table, "x.jpg", threshold=0.5))
    page = watched.page
    page.locator("#count", has_text="2 of 3 recovered strokes have a confidence of 0.50 or more").wait_for()
    assert page.locator("#rose path.bin[d^='M0 0L']").count() == 36
    box = page.locator("#canvas").bounding_box()
    tap = {"x": box["width"] * 65 / 80, "y": box["height"] * 30 / 60}
    page.locator("#canvas").click(position=tap)
    card = page.locator("#stroke")
    assert card.locator("[data-field=length]").inner_text() == "22 mm (44 px)"
    assert card.locator("[data-field=direction]").inner_text() == "90° clockwise"
    assert card.locator("[data-field=order]").inner_text() == "3 of 3, from the bottom"
    for kind in ("csv", "geojson", "svg"):
        with page.expect_download() as download:
            page.locator(f"[data-export={kind}]").click()
        download.value.save_as(tmp_path / f"shown.{kind}")
    lines = list(csv.DictReader(io.StringIO((tmp_path / "shown.csv").read_text())))
    assert list(lines[0])[:6] == ["stroke", "order", "confidence", "x [px]", "y [px]", "length [mm]"]
    assert [float(line["length [mm]"]) for line in lines] == pytest.approx([12.5, 22], rel=1e-3)
    assert [float(line["direction [deg clockwise]"]) for line in lines] == pytest.approx([45, 90], abs=0.01)
    shapes = json.loads((tmp_path / "shown.geojson").read_text())
    ring = np.array(shapes["features"][1]["geometry"]["coordinates"][0])
    assert (ring[0] == ring[-1]).all()
    assert 0.5 * (ring.min(0) + ring.max(0)) == pytest.approx([32.5, -15], abs=1)  # millimetres, y upwards
    assert (tmp_path / "shown.svg").read_text().count("<polygon") == 2
    page.locator("#threshold").fill("0.8")
    page.locator("#count", has_text="1 of 3").wait_for()
    page.locator("#color-by").select_option("direction")
    page.locator("[data-zoom=one]").click()
    page.locator("#scale", has_text="100 %").wait_for()
    page.locator("#look-at").press("Escape")
    assert card.get_attribute("data-empty") == "true"
    assert not watched.errors


@pytest.mark.parametrize("width", [390, 1280])
def test_it_fits_every_screen(width, opened, tmp_path):
    table, image = table_and_image()
    tables = {"Measures": [{"measure": "length", "unit": "px", "value": "3"}]}
    page = write_page(tmp_path, image, table, "x" * 80, tables=tables)
    watched = opened(page, (width, 800), color_scheme="dark")
    assert watched.page.evaluate("document.documentElement.scrollWidth") <= width
    nav = watched.page.evaluate(
        "(({ scrollWidth, clientWidth }) => [scrollWidth, clientWidth])(document.querySelector('.nav'))"
    )
    assert nav[0] <= nav[1]  # no section is cut off
    assert not watched.errors


FIFTH = SIZE[0] * SIZE[1] / 5  # pixels in a fifth of the photograph


@pytest.mark.parametrize(
    ("width", "seen", "words"),
    [
        (7.0, FIFTH, None),
        (4.0, FIFTH, "narrower than 4.0 pixels"),
        (7.0, 50.0, "on only 3 % of the photograph"),
    ],
)
def test_what_is_doubtful_is_said_with_what_to_do_about_it(width, seen, words):
    table, _ = table_and_image()
    columns = {**table.columns, "width": np.full(3, width), "seen": np.full(3, seen)}
    remark = remark_on(replace(table, columns=columns))
    assert remark is None if words is None else words in remark


def test_bare_ground_is_told_from_paint_that_was_not_read():
    found, image = recovered()
    ground = np.zeros(SIZE, bool)
    ground[:, 72:] = True  # a tenth of the photograph, without strokes
    table = tabulate_strokes(replace(found, ground=ground))
    table = replace(table, columns={**table.columns, "seen": np.full(3, FIFTH / 3)})
    words = "10 % looks like bare ground, and 70 % like paint in which no stroke can be told apart"
    assert words in remark_on(table)
    assert words in page_of((255 * image).astype(np.uint8), table, "x")
    assert "the rest is bare ground, or paint" in remark_on(replace(table, ground=None))


@pytest.mark.parametrize(
    ("confidence", "ground", "words"),
    [
        ([], 0.0, "no strokes were found"),
        ([0.05, 0.08, 0.9], 0.0, "half of the strokes found have a confidence of 0.08 or less"),
        ([0.1, 0.15, 0.9], 0.3, "half of the strokes found have a confidence of 0.15 or less"),
        ([0.1, 0.15, 0.9], 0.1, None),
        ([0.4, 0.4, 0.4], 0.65, "65 % of it looks bare"),
        ([0.8, 0.8, 0.8], 0.65, None),
        ([0.1, 0.25, 0.9], 0.39, None),
    ],
)
def test_a_picture_that_does_not_look_like_paint_is_told(confidence, ground, words):
    table, image = table_and_image()
    count = len(confidence)
    columns = {name: column[:count] for name, column in table.columns.items()}
    columns |= {"confidence": np.array(confidence), "seen": np.full(count, FIFTH)}
    table = replace(
        table,
        columns=columns,
        color=table.color[:count],
        lines=table.lines[:count],
        outlines=table.outlines[:count],
        ground=ground,
    )
    html = page_of((255 * image).astype(np.uint8), table, "x")
    if words is None:
        assert remark_on(table) is None
        assert "does not look like paint" not in html
    else:
        assert f"this does not look like paint: {words}" in remark_on(table)
        assert f"This does not look like paint: {words}" in html


def test_numbers_have_three_digits_and_no_powers_of_ten():
    written = [format_number(value) for value in (0, 1234.5, -12.345, 0.00123456, 1.09e-5, -4.4e-4, np.nan, np.inf)]
    assert written == ["0", "1234", "-12.3", "0.00123", "0.00001", "-0.00044", None, None]
