"""Tests of a sweep's report, however its runs ended: results, tables, contact sheet and page in a real browser."""

import json
import logging
import re
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from browser import NARROW, WIDE
from brushexp_studies import contact_sheet
from brushexp_studies.contact_sheet import LIMIT, THUMBNAIL_SIDE, SheetCell, draw_sheet
from brushexp_studies.pareto import front_table, trade_of
from films import pixels_of
from hydra.core.utils import JobReturn, JobStatus
from hydra.types import RunMode
from omegaconf import OmegaConf
from PIL import Image
from sweeps import collect, make_grid, make_run, note, read_csv, write_words

from brushexp.errors import UserError, first_line
from brushexp.pages.sweep_page import AREA, SIDES, _thumbnail, side_for, sweep_page, thumbnail, write_sweep_page
from brushexp.reporting.tables import csv_table, latex_table, markdown_table
from brushexp.results.runs import gather, parse_overrides
from brushexp.results.tables import write_run_tables
from brushexp.runs import sweep_report
from brushexp.runs.sweep_report import SweepReport, note_failure, renew_sweep_report
from brushexp.system.files import write_picture

METRICS = {
    **{"psnr": 27.123456, "ssim": 0.87654321, "l1": 0.0312345, "perceptual": None, "seconds": 12.3456},
    **{"peak_memory_mb": 512.0, "n_strokes": 2600, "steps": 500, "device": "cpu"},
}
ERROR = "RuntimeError: stroke 17 | is *singular*"


def fail(folder: Path, number: int, error: str = ERROR) -> None:
    run = folder / str(number)
    (run / "painting.png").unlink()
    note(folder, number, status="failed", error=error, **dict.fromkeys(["psnr", "seconds"]))


def painted(folder: Path, axes: dict[str, list[str]]) -> None:
    """Make a sweep in which run k has a painting of grey level 20 + k and a target of grey level 200."""
    make_grid(folder, axes)
    for run in folder.iterdir():
        write_picture(run / "target.png", np.full((24, 32, 3), 200, np.uint8))
        write_picture(run / "painting.png", np.full((24, 32, 3), 20 + int(run.name), np.uint8))


def tables(folder: Path) -> list[str]:
    write_run_tables(folder, collect(folder))
    return [(folder / f"table.{kind}").read_text() for kind in ("csv", "md", "tex")]


def sheet(folder: Path) -> Path | None:
    return contact_sheet.write_contact_sheet(folder, collect(folder))


def greys(path: Path) -> list[list[int]]:
    """Return the grey levels of the pictures on a contact sheet, row by row."""
    rows: list[list[int]] = []
    for line in pixels_of(path)[..., 0]:
        starts = np.flatnonzero(np.diff(line, prepend=-1))
        long = starts[np.diff(starts, append=len(line)) > 100]
        row = [int(level) for level in line[long] if level in (*range(20, 80), 100, 200)]
        if row and row not in rows[-1:]:
            rows.append(row)
    return rows


def test_a_table_is_csv_markdown_and_latex():
    rows = [{"name": "a|b_c", "n": 1, "x": 0.1 + 0.2, "ok": True}, {"name": "1 ± 2 %", "n": None, "x": float("nan")}]
    assert csv_table(rows).splitlines() == ["name,n,x,ok", "a|b_c,1,0.30000000000000004,True", "1 ± 2 %,,,"]
    assert markdown_table(rows, {"x": 2}).splitlines() == [
        "| name | n | x | ok |",
        "| --- | ---: | ---: | --- |",
        r"| a\|b\_c | 1 | 0.30 | True |",
        "| 1 ± 2 % | – | – | – |",
    ]
    latex = latex_table(rows, {"x": 2})
    assert r"\begin{tabular}{lrrl}" in latex
    assert r"1 $\pm$ 2 \% & -- & -- & --" in latex
    assert csv_table({"a": np.array([1 / 3, np.nan]), "b": [1, 2]}, significant=3) == "a,b\n0.333,1\n,2\n"
    table = markdown_table({"a": ["*x*"], "b": ["1 px"]}, align="lr", escape=False)
    assert table == "| a | b |\n| --- | ---: |\n| *x* | 1 px |"
    shown = markdown_table({"x": ["a|b", "*_x_*", "[mse](x)", "<b>", "a\nb`"]}).splitlines()[2:]
    assert shown == [r"| a\|b |", r"| \*\_x\_\* |", r"| \[mse\](x) |", r"| \<b\> |", r"| a b\` |"]


def test_results_come_in_the_order_of_the_job_numbers_and_an_unreadable_one_counts_as_failed(tmp_path):
    for name, text in {"10": "", "2": "{", "0": "[1, 2]", "1": "\x00", "x": "{}"}.items():
        (make_run(tmp_path, {}, name=name) / "metrics.json").write_text(text)
    tables(tmp_path)
    rows = read_csv(tmp_path / "table.csv")
    assert [row["run"] for row in rows] == ["0", "1", "2", "10", "x"]
    assert [row["status"] for row in rows] == ["failed"] * 4 + ["completed"]
    assert all("metrics.json cannot be read" in row["error"] for row in rows[:-1])


def test_the_csv_has_every_column_in_full_precision_and_one_for_a_setting_with_the_name_of_another(tmp_path):
    settings = {"init": "grid", "image": "a,b.png", "seconds": "10", "device": "auto", "status": "x", "output": "there"}
    make_run(tmp_path, settings, **METRICS, anytime=[[0.1, 20.0]])
    make_run(tmp_path, {"init": "slic"}, status="failed", error=ERROR * 100)
    _, text, latex = tables(tmp_path)
    assert text.splitlines()[2].startswith(
        "| run | init | image | override.seconds | device | override.status | status |"
    )
    assert max(map(len, text.splitlines())) < 400, "a long error is cut"
    assert "failed" not in latex
    first, second = read_csv(tmp_path / "table.csv")
    assert {key: float(first[key]) for key in ("psnr", "ssim", "l1")} == {
        key: METRICS[key] for key in ("psnr", "ssim", "l1")
    }
    assert (first["image"], first["n_strokes"], first["error"], first["init"]) == ("a,b.png", "2600", "", "grid")
    for key in ("seconds", "device", "status"):
        assert first[f"override.{key}"] == settings[key] != first[key]
    assert "perceptual" not in first, "nothing is known of it"
    assert (second["status"], second["error"], second["psnr"], second["init"]) == ("failed", ERROR * 100, "", "slic")


def test_only_what_varies_is_in_the_markdown_after_means_over_seeds(tmp_path):
    chosen = [("grid", 0, 20.0), ("grid", 1, 22.0), ("slic", 0, 30.0)]
    for init, seed, psnr in chosen:
        make_run(tmp_path, {"image": "cat.png", "init": init, "seed": str(seed)}, psnr=psnr, seconds=1.0, n_strokes=26)
    make_run(tmp_path, {"image": "cat.png", "init": "slic", "seed": "1"}, status="failed", error=ERROR)
    _, text, latex = tables(tmp_path)
    lines = text.splitlines()
    assert lines[0] == "Mean ± standard deviation over seeds."
    assert lines[2:6] == [
        r"| init | runs | psnr | seconds | n\_strokes |",
        "| --- | ---: | ---: | ---: | ---: |",
        "| grid | 2 | 21.00 ± 1.41 | 1.0 ± 0.0 | 26 ± 0 |",
        "| slic | 1 | 30.00 | 1.0 | 26 |",
    ]
    assert lines[7] == "4 runs, 1 failed."
    assert lines[9] == r"| run | init | seed | status | psnr | seconds | n\_strokes |"
    assert lines[11] == "| 0 | grid | 0 | completed | 20.00 | 1.0 | 26 |"
    assert lines[14] == r"| 3 | slic | 1 | failed: RuntimeError: stroke 17 \| is \*singular\* | – | – | – |"
    assert r"grid & 2 & 21.00 $\pm$ 1.41 &" in latex


def test_an_infinite_psnr_is_shown(tmp_path):
    make_run(tmp_path, {"loss": "[mse,kl]"}, psnr=None, l1=0.0, loss="mse+kl")  # the names of losses stand for it
    make_run(tmp_path, {}, psnr=None, l1=0.1)
    lines = tables(tmp_path)[1].splitlines()
    assert lines[4].startswith("| 0 | mse+kl | completed | inf |")
    assert lines[5].startswith("| 1 |  | completed | – |")


@pytest.mark.parametrize(("axes", "expected"), [
    ({"seed": ["1", "2", "3"]}, [[200, 20, 21, 22]]),
    ({"seed": list("012345")}, [[200, 20, 21, 22], [23, 24, 25]]),  # rows are about equally full
    ({"loss": ["mse", "kl"], "init": ["grid", "slic", "fill"]}, [[200, 20, 21, 22], [200, 23, 24, 25]]),  # a matrix
])  # fmt: skip
def test_the_target_comes_first_and_every_run_follows(tmp_path, axes, expected):
    painted(tmp_path, axes)
    assert greys(sheet(tmp_path)) == expected


def test_an_incomplete_matrix_is_laid_out_row_by_row_and_a_failed_run_is_a_grey_box(tmp_path):
    painted(tmp_path, {"loss": ["mse", "kl"], "init": ["grid", "slic", "fill"]})
    (tmp_path / "5" / "metrics.json").unlink()
    fail(tmp_path, 1)
    assert greys(sheet(tmp_path)) == [[200, 20, 22, 23, 24]]
    assert (pixels_of(tmp_path / "sheet.png") == 0xED).all(-1).sum() > 30_000


def test_every_target_stands_where_its_runs_are(tmp_path):
    painted(tmp_path, {"image": ["/d/a.png", "/d/b.png"], "init": ["grid", "slic"]})
    for number in (2, 3):
        write_picture(tmp_path / str(number) / "target.png", np.full((24, 32, 3), 100, np.uint8))
    assert greys(sheet(tmp_path)) == [[200, 20, 21], [100, 22, 23]]
    for number in range(4):
        write_words(tmp_path / str(number), f"seed={number}")
    assert greys(sheet(tmp_path)) == [[200, 20, 21, 100, 22, 23]]


def test_a_sheet_of_looks_has_a_row_for_each_picture_as_high_as_it_needs(tmp_path):
    """The sheet has a row per picture even if pictures outnumber looks and each look has its own loss."""
    painted(tmp_path, {"look": ["oil", "ink"], "image": ["/d/a.png", "/d/b.png", "/d/c.png"]})
    for number in range(6):
        note(tmp_path, number, loss="mse" if number < 3 else "mse+width")
    for number in (1, 4):  # the second picture is tall, and its target differs
        write_picture(tmp_path / str(number) / "target.png", np.full((32, 16, 3), 100, np.uint8))
        write_picture(tmp_path / str(number) / "painting.png", np.full((32, 16, 3), 20 + number, np.uint8))
    for number in (2, 5):
        write_picture(tmp_path / str(number) / "target.png", np.full((24, 32, 3), 60, np.uint8))
    assert greys(sheet(tmp_path)) == [[200, 20, 23], [100, 21, 24], [60, 22, 25]]
    levels = pixels_of(tmp_path / "sheet.png")[..., 0]
    first, high, last = (np.flatnonzero((levels == level).sum(1) > THUMBNAIL_SIDE // 3)[0] for level in (200, 100, 60))
    assert last - high > high - first + THUMBNAIL_SIDE // 5


def test_renderers_have_their_metrics_and_their_pictures(tmp_path):
    metrics = {"l2": 0.0012345, "psnr_alpha": 24.318, "fid_effl0": 12.3456, "strokes_per_second": 512.4}
    for level, name in ((100, "analytic"), (101, "neural")):
        run = make_run(tmp_path, {"renderer": name}, picture="strokes.png", **metrics)
        assert sheet(tmp_path) is None or name != "analytic"  # no sheet without a picture
        write_picture(run / "strokes.png", np.full((90, 900, 3), level, np.uint8))
    lines = tables(tmp_path)[1].splitlines()
    assert lines[2] == r"| run | renderer | status | l2 | psnr\_alpha | fid\_effl0 | strokes\_per\_second |"
    assert lines[4] == "| 0 | analytic | completed | 0.001234 | 24.32 | 12.35 | 512 |"
    assert "picture" not in read_csv(tmp_path / "table.csv")[0]
    pixels = pixels_of(sheet(tmp_path))[..., 0]
    assert all((pixels == level).any(0).sum() > 790 for level in (100, 101))  # twice the width of a painting


def test_damaged_pictures_and_those_of_all_shapes_fit(tmp_path):
    for number, size in enumerate([(1, 1), (900, 30), (30, 900), (1, 2000), (500, 400)]):
        make_run(tmp_path, {"seed": str(number)}, target=200, color=20 + number, size=size)
    make_run(tmp_path, {"seed": "9"}, status="interrupted")  # a run without a picture
    path = tmp_path / "4" / "painting.png"
    for share in (0.9, 0.5, 0.0):
        path.write_bytes(path.read_bytes()[: int(path.stat().st_size * share)])
        with Image.open(sheet(tmp_path)) as picture:
            assert max(picture.size) < 6 * (THUMBNAIL_SIDE + 40)


@pytest.mark.parametrize(("count", "long"), [(200, True), (201, False), (13, True)])
def test_large_sheets_stay_within_bounds(count, long):
    label = ("some.very.long_name=of/a/value/that/does/not/fit" * (8 if long else 1), "27.1 dB")
    columns = 15 if count > 100 else 1
    cells = [SheetCell(Image.new("RGB", (40, 40)), label) for _ in range(count)]
    assert max(draw_sheet([cells[i : i + columns] for i in range(0, count, columns)], "title").size) <= LIMIT


def end_job(folder: Path, number: int, outcome: object, mode: str = "MULTIRUN") -> None:
    """Call the hook that Hydra calls after a job, with a report due; ``outcome`` is metrics or an exception."""
    sweep_report._next_report = 0.0
    config = OmegaConf.create({"hydra": {"runtime": {"output_dir": str(folder / str(number))}, "mode": RunMode[mode]}})
    status = JobStatus.FAILED if isinstance(outcome, Exception) else JobStatus.COMPLETED
    SweepReport().on_job_end(config, JobReturn(status=status, _return_value=outcome))


def test_every_job_of_a_sweep_renews_the_table_and_one_that_failed_says_why_beside_its_numbers(tmp_path):
    for number in range(4):
        make_run(tmp_path, {"loss": "[mse,kl]"}, name=str(number), **METRICS)
    (tmp_path / "2" / "metrics.json").unlink()
    note_failure(tmp_path / "1", RuntimeError("first line\nsecond line"))
    note_failure(tmp_path / "2", KeyboardInterrupt())
    end_job(tmp_path, 3, METRICS)
    rows = read_csv(tmp_path / "table.csv")
    assert [row["status"] for row in rows] == ["completed", "failed", "interrupted", "completed"]
    assert (rows[1]["error"], rows[1]["steps"], rows[2]["steps"]) == ("RuntimeError: first line", "500", "")
    make_run(tmp_path / "single", {}, name="0", **METRICS)
    end_job(tmp_path / "single", 0, METRICS, mode="RUN")
    assert [path.name for path in (tmp_path / "single").iterdir()] == ["0"]


def test_overrides_and_errors_of_every_form_are_read_and_trouble_with_the_report_is_logged(tmp_path, caplog):
    words = ["loss=mse", "+a.b=1", "++c=x=y", "~d", "e=", "+f=[1,2]"]
    expected = {"loss": "mse", "a.b": "1", "c": "x=y", "d": "(removed)", "e": "", "f": "[1,2]"}
    assert parse_overrides(words) == expected
    errors = UserError("a; b"), KeyError(), ValueError("\nx\ny")
    assert [first_line(error) for error in errors] == ["a; b", "KeyError", "ValueError: x"]
    (tmp_path / "table.csv").mkdir()
    make_run(tmp_path, {}, name="0", **METRICS)
    end_job(tmp_path, 0, METRICS)
    record = caplog.records[-1]
    assert record.levelno == logging.ERROR
    assert "table.csv: Is a directory" in record.getMessage()


@pytest.mark.parametrize("mode", ["RUN", "MULTIRUN"])
def test_an_error_reaches_the_log_of_its_run(tmp_path, mode, caplog):
    handler = logging.FileHandler(tmp_path / "run.log")
    logging.getLogger().addHandler(handler)
    try:
        try:
            raise RuntimeError("a bug\nin two lines")
        except RuntimeError as error:
            end_job(tmp_path, 3, error, mode)
        end_job(tmp_path, 4, UserError("strokes is -1; choose strokes=1000"), mode)
    finally:
        logging.getLogger().removeHandler(handler)
        handler.close()
    text = (tmp_path / "run.log").read_text()
    assert "run 3 failed: RuntimeError: a bug\nTraceback" in text
    assert text.endswith("run 4 failed: strokes is -1; choose strokes=1000\n")
    assert bool(caplog.records) == (mode == "MULTIRUN")  # Hydra itself shows the error of a single run


def test_the_last_of_many_writers_sees_all_results(tmp_path):
    def work(number: int) -> None:
        make_run(tmp_path, {"seed": str(number)}, name=str(number), target=200, color=20 + number)
        renew_sweep_report(tmp_path)

    with ThreadPoolExecutor(4) as pool:
        list(pool.map(work, range(6)))
    assert len(read_csv(tmp_path / "table.csv")) == 6
    assert sum(map(len, greys(tmp_path / "sheet.png"))) == 7
    files = {path.name for path in tmp_path.iterdir() if path.is_file()}
    assert files <= {"table.csv", "table.md", "table.tex", "sheet.png", "report.html"}


EVIL = "<script>document.title=1</script>"
SETTINGS = [  # steps, loss, seconds, PSNR, SSIM
    ("100", "mse", 2.0, 30.0, 0.90),
    ("30", "mse", 0.5, 25.0, 0.80),
    ("1500", "mse", 20.0, 33.0, 0.95),
    ("100", "ssim", 4.0, 28.0, 0.93),
    ("30", "ssim", 1.0, 24.0, 0.85),
    ("1500", "ssim", 40.0, 31.0, 0.97),
]


def make_sweep(folder: Path) -> Path:
    """Make a sweep of one failed run and six finished runs, one of which has its own page."""
    folder.mkdir()
    for k, (steps, loss, seconds, psnr, ssim) in enumerate(SETTINGS):
        numbers = {"seconds": seconds, "psnr": psnr, "ssim": ssim, "n_strokes": 24, "loss": loss}
        numbers["anytime"] = [[0, 15], [seconds / 2, psnr - 2], [seconds, psnr]]
        make_run(folder, {"steps": steps, "loss": loss}, target=200, color=20 * k, **numbers)
    (folder / "2" / "report.html").write_text("a page")
    make_run(folder, {"background": EVIL}, status="failed", error=f"{EVIL} is no colour")
    return folder


@pytest.fixture(scope="module")
def sweep(tmp_path_factory) -> Path:
    folder = make_sweep(tmp_path_factory.mktemp("pages") / "sweep & more")
    return page_of(folder)


def page_of(folder: Path) -> Path:
    return write_sweep_page(folder, collect(folder))


def order(page) -> list[str]:
    """Return the names of the visible runs, from top to bottom."""
    return page.evaluate("[...document.querySelectorAll('#table tr:not([hidden]) .name')].map(e => e.dataset.sort)")


def data_in(html: str) -> dict:
    return json.loads(re.search(r'<script type="application/json" id="data">(.*?)</script>', html, re.S)[1])


def test_the_table_sorts_filters_and_shows_what_was_typed_as_text(sweep, opened):
    watched = opened(sweep)
    page = watched.page
    head = page.locator("#table th", has_text="PSNR")
    head.get_by_role("button").click()
    assert order(page) == ["2", "5", "0", "3", "1", "4", "6"]  # best first; missing numbers last
    assert head.get_attribute("aria-sort") == "descending"
    head.get_by_role("button").press("Enter")
    assert order(page) == ["4", "1", "3", "0", "5", "2", "6"]
    assert head.get_attribute("aria-sort") == "ascending"
    page.locator("#table th", has_text="steps").get_by_role("button").click()
    assert order(page) == ["4", "1", "3", "0", "5", "2", "6"]  # 30, 100, 1500; ties keep their order
    assert head.get_attribute("aria-sort") == "none"
    page.locator("[popovertarget]", has_text="steps").press("Enter")
    page.get_by_label("100", exact=True).check()
    page.get_by_label("1500", exact=True).check()
    assert order(page) == ["3", "0", "5", "2"]
    page.keyboard.press("Escape")
    assert page.evaluate("document.activeElement.textContent.trim().startsWith('steps')")
    page.get_by_label("Search in runs").fill("SSIM 1500")
    assert order(page) == ["5"]
    assert page.locator("#count").text_content() == "1 of 7 runs"
    assert page.locator("#points .point").count() == 1
    assert page.locator("#curves .curve").count() == 1
    page.get_by_label("Search in runs").fill("nothing like it")
    page.get_by_role("button", name="Clear").click()
    assert len(order(page)) == 7
    row = page.locator("tr[data-row='6']")
    assert row.locator(".error").text_content() == f"{EVIL} is no colour"
    assert row.locator("td.repeat code").text_content() == f"brushexp 'background={EVIL}'"
    page.locator("[popovertarget]", has_text="background").click()
    page.locator(".choices .chip", has_text="script>").click()
    assert order(page) == ["6"]
    assert page.title() == "sweep & more – brushexp"
    html = sweep.read_text()
    assert EVIL not in html
    assert 'http-equiv="Content-Security-Policy" content="default-src \'none\'; img-src data:;' in html


def test_runs_are_compared_and_settings_pointed_at(sweep, opened):
    page = opened(sweep).page
    frame = collect(sweep.parent)
    table = front_table(frame, trade_of(frame))
    labels = page.locator(".point.on").evaluate_all("found => found.map(e => e.getAttribute('aria-label'))")
    assert {label.partition(":")[0] for label in labels} == set(table["overrides"][table["front_psnr"]])
    assert all(label.endswith("on the front") for label in labels)
    label = page.locator("#pointed-label")
    page.locator("#points .point[tabindex='0']").focus()
    page.keyboard.press("Home")
    assert "steps=30 loss=mse: PSNR, dB 25" in page.evaluate("document.activeElement.getAttribute('aria-label')")
    assert page.locator("#pointed-command").text_content() == "brushexp steps=30 loss=mse"
    page.keyboard.press("ArrowRight")
    assert label.text_content() == "steps=30 loss=ssim"
    assert page.locator("#curves .hot").count() == 1
    page.keyboard.press("End")
    assert label.text_content() == "steps=1500 loss=ssim"
    page.locator("#points [data-group='2']").hover()  # the keyboard's choice stays until a click
    assert label.text_content() == "steps=1500 loss=ssim"
    page.locator("#points [data-group='2']").click()
    assert page.locator("#pointed-report").get_attribute("href") == "2/report.html"
    page.locator("#pointed").get_by_role("button", name="Compare").click()
    assert page.get_by_label("Compare run 2", exact=True).is_checked()
    page.get_by_role("button", name="Copy the command").click()
    page.get_by_role("button", name="Copied").wait_for()
    page.get_by_label("Search in runs").press("Control+V")
    assert page.get_by_label("Search in runs").input_value() == "brushexp steps=1500 loss=mse"
    page.get_by_role("button", name="Clear").click()
    assert page.get_by_label("Compare run 6", exact=True).is_disabled()  # it has no picture
    page.get_by_label("Compare run 2", exact=True).click()  # a second click deselects the run
    for name in ("1", "1", "2", "4"):
        page.get_by_label(f"Compare run {name}", exact=True).click()
    for k, name in enumerate(("2", "4")):
        inside = page.locator(f"tr[data-row='{name}'] .pictured img").get_attribute("src")
        assert page.locator("#beside .wipe img").nth(k).get_attribute("src") == inside
    cells = page.locator("#differences tr", has_text="PSNR").locator("td").all_text_contents()
    assert cells == ["33.00", "24.00", "−9.00"]
    page.locator("#beside input[type=range]").press("Home")
    assert page.evaluate("document.querySelector('.wipe').style.getPropertyValue('--split')") == "0%"
    shape = page.locator("#beside .wipe").bounding_box()
    assert shape["width"] / shape["height"] == pytest.approx(3 / 2, rel=0.02)
    page.keyboard.press("Escape")
    assert not page.locator("#beside").is_visible()
    assert page.locator(".choose :checked").count() == 0
    page.locator("tr[data-row='3'] .picture").click()  # next to its target
    assert page.evaluate("[left.value, right.value]") == ["target 0", "run 3"]
    assert page.locator("#beside .wipe-label").nth(1).text_content() == "run 3: steps=100 loss=ssim"
    page.keyboard.press("Escape")
    page.locator("#along").select_option("axis:loss")
    page.locator("#up").select_option("ssim")
    assert {"mse", "ssim", "SSIM"} <= set(page.locator("#points .axes text").all_text_contents())
    assert page.locator("#points .point").count() == 6


def test_the_page_fits_asks_nothing_and_complains_of_nothing(sweep, opened):
    watched = opened(sweep, has_touch=True)
    page = watched.page
    too_wide = "document.getElementById('beside').scrollWidth > document.getElementById('beside').clientWidth"
    for size, dark in ((WIDE, "light"), (WIDE, "dark"), (NARROW, "dark"), (NARROW, "light")):
        page.set_viewport_size({"width": size[0], "height": size[1]})
        page.emulate_media(color_scheme=dark)
        page.locator("[popovertarget]", has_text="steps").click()
        assert not watched.is_too_wide()
        page.keyboard.press("Escape")
        page.locator("tr[data-row='0'] .picture").click()
        assert not watched.evaluate(too_wide)
        page.keyboard.press("Escape")
    page.locator("#table th", has_text="PSNR").get_by_role("button").click()  # narrow pages show sortable cards
    assert order(watched.page)[:2] == ["2", "5"]
    boxes = [page.locator(f"tr[data-row='{k}']").bounding_box() for k in (2, 5)]
    assert boxes[0]["x"] == boxes[1]["x"]
    assert boxes[0]["y"] + boxes[0]["height"] < boxes[1]["y"]
    assert not watched.errors
    assert not watched.foreign


def test_seeds_have_means_and_differences(tmp_path):
    runs = [("1", "0", 20.0), ("1", "1", 22.0), ("2", "0", 30.0), ("2", "1", 31.0)]
    for k, (steps, seed, psnr) in enumerate(runs):
        make_run(tmp_path, {"steps": steps, "seed": seed}, color=50, psnr=psnr, seconds=1.0 + k)
    html = page_of(tmp_path).read_text()
    assert 'id="paired"' not in html, "two say nothing about differences"
    assert html.index('id="runs"') < html.index('id="plots"') < html.index('id="means"'), "paintings come first"
    for steps, psnr in (("1", 21.0), ("2", 30.0)):
        make_run(tmp_path, {"steps": steps, "seed": "2"}, color=50, psnr=psnr, seconds=1.0)
    html = page_of(tmp_path).read_text()
    means = html[html.index('<section id="means"') : html.index('<section id="paired"')]
    assert re.findall(r"<td.*?>(.*?)</td>", means)[:3] == ["1", "3", "21.00 ± 1.00"]
    assert "<td>steps=2</td>" in html[html.index('<section id="paired"') :]
    assert "the mean over its seeds" in html
    ids = re.findall(r' id="([^"]+)"', html)
    assert len(ids) == len(set(ids))


def test_long_names_of_pictures_do_not_widen_the_page(opened, tmp_path):
    for k, (image, look) in enumerate((image, look) for image in ("first", "second") for look in ("ink", "oil")):
        chosen = {"image": f"{image} photograph with a very long name indeed.jpg", "look": look}
        make_run(tmp_path, chosen, target=ord(image[0]), color=50, psnr=20.0 + k, seconds=1.0 + k)
    narrow = opened(page_of(tmp_path), NARROW)
    assert not narrow.is_too_wide()
    assert narrow.page.locator(".nav a[href='#runs']").is_visible(), "a page of many paintings is long"


def test_many_settings_have_one_column_and_links_lead_from_where_the_page_is(tmp_path):
    for k in range(4):
        chosen = {f"axis{n}": str(k // 2 + n) for n in range(5)} | {"seed": str(k % 2)}
        make_run(tmp_path, chosen, psnr=20.0 + k, seconds=1.0)
    html = page_of(tmp_path).read_text()
    assert '<td role="cell" class="settings"><code>axis0=0</code>' in html
    assert "<td>axis0=1 axis1=2 axis2=3 axis3=4 axis4=5</td>" in html  # in the table of means
    make_sweep(tmp_path / "sweep?")
    (tmp_path / "comparison").mkdir()
    html = sweep_page(tmp_path / "comparison", gather([tmp_path / "sweep?"], tmp_path / "comparison"))
    assert '<a href="../sweep%3F/2/report.html">' in html
    assert [row["name"] for row in data_in(html)["rows"]] == list("0123456")


def test_settings_are_compared_on_one_picture_and_an_album_begins_with_its_paintings(tmp_path):
    for k, image in enumerate(("a.png", "a.png", "b.png", "b.png")):
        chosen, curve = {"image": image, "steps": str(k % 2)}, [[0.1, 9.0], [1.0 + k, 20.0 + k]]
        make_run(tmp_path, chosen, target=ord(image[0]), color=50, psnr=20.0 + k, seconds=1.0 + k, anytime=curve)
    html = page_of(tmp_path).read_text()
    groups = data_in(html)["groups"]
    assert [group["picture"] for group in groups] == [0, 0, 1, 1]
    assert [group["ahead_from"] is None for group in groups] == [False, False, False, False]
    assert html.count("<figcaption>target: ") == 2
    for k in (1, 3):
        (tmp_path / str(k) / "metrics.json").unlink()
    html = page_of(tmp_path).read_text()
    assert html.index('alt="run 0') < html.index('alt="target: a')
    assert 'value="cards" checked' in html
    assert 'id="plots"' not in html


def test_the_page_of_a_folder_of_pictures_shows_paintings_and_figures_on_request(tmp_path, opened):
    for k, image in enumerate(("a.png", "b.png")):
        make_run(tmp_path, {"image": image}, target=k, color=50, psnr=20.0 + k, anytime=[[0.1, 9.0], [1.0, 20.0]])
    watched = opened(page_of(tmp_path))
    page = watched.page
    assert page.locator(".lead").first.text_content() == "2 paintings."
    figures = (".runs thead", "td.number", "td.repeat", ".filters")
    assert not any(page.locator(part).first.is_visible() for part in figures)
    assert page.locator("td.pictured img").first.is_visible()
    page.locator("#figures summary").click()
    assert all(page.locator(part).first.is_visible() for part in figures)
    assert not watched.errors


def test_sweeps_of_other_tasks_and_of_one_failed_run_have_a_page_without_pictures(tmp_path):
    for k, width in enumerate(("16", "32", "64")):
        make_run(tmp_path, {"renderer.width": width}, l2=0.1 / (k + 1))
    html = page_of(tmp_path).read_text()
    assert "What the settings do</h2>" in html
    assert html.count('class="no-picture"') == len(data_in(html)["groups"]) == 3
    (tmp_path / "0" / "metrics.json").unlink()
    make_run(tmp_path / "0", {}, status="failed", error="no")
    html = page_of(tmp_path / "0").read_text()
    assert 'id="plots"' not in html
    assert [row["error"] for row in data_in(html)["rows"]] == ["no"]


def test_pictures_are_encoded_once(tmp_path):
    write_picture(tmp_path / "a.png", np.zeros((100, 700, 3), np.uint8))
    _thumbnail.cache_clear()
    first = thumbnail(tmp_path / "a.png", 640)
    assert (first["width"], first["height"]) == (640, 91)
    assert thumbnail(tmp_path / "a.png", 640) is first
    write_picture(tmp_path / "a.png", np.zeros((100, 80, 3), np.uint8))
    assert thumbnail(tmp_path / "a.png", 640)["width"] == 80  # made again, without enlarging
    assert _thumbnail.cache_info().misses == 2
    assert thumbnail(tmp_path / "none.png", 640) is None
    (tmp_path / "bad.png").write_bytes(b"no picture")
    assert thumbnail(tmp_path / "bad.png", 640) is None
    for count in range(1, 2500, 7):  # the more runs, the smaller
        side = side_for(count)
        assert count * side**2 <= AREA
        assert side == SIDES[0] or count * SIDES[SIDES.index(side) - 1] ** 2 > AREA
