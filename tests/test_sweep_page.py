"""The page of a sweep: sorted, filtered, compared and pointed at in a real browser; and what is in it."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from browser import NARROW, WIDE
from brushexp_studies.pareto import front_table
from sweeps import collect, make_run

from brushexp.pages.sweep_page import AREA, SIDES, _thumbnail, side_for, sweep_page, thumbnail, write_sweep_page
from brushexp.results.runs import gather
from brushexp.system.files import write_picture

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
    """Six finished runs, of which one has a page of its own, and one that failed."""
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
    """The names of the shown runs, from the top."""
    return page.evaluate("[...document.querySelectorAll('#table tr:not([hidden]) .name')].map(e => e.dataset.sort)")


def data_in(html: str) -> dict:
    return json.loads(re.search(r'<script type="application/json" id="data">(.*?)</script>', html, re.S)[1])


def test_the_table_sorts_filters_and_shows_what_was_typed_as_text(sweep, opened):
    watched = opened(sweep)
    page = watched.page
    head = page.locator("#table th", has_text="PSNR")
    head.get_by_role("button").click()
    assert order(page) == ["2", "5", "0", "3", "1", "4", "6"]  # the better first; no number last
    assert head.get_attribute("aria-sort") == "descending"
    head.get_by_role("button").press("Enter")
    assert order(page) == ["4", "1", "3", "0", "5", "2", "6"]
    assert head.get_attribute("aria-sort") == "ascending"
    page.locator("#table th", has_text="steps").get_by_role("button").click()
    assert order(page) == ["4", "1", "3", "0", "5", "2", "6"]  # 30, 100, 1500; alike ones stay as they were
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
    table = front_table(collect(sweep.parent))
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
    page.locator("#points [data-group='2']").hover()  # what was walked to stays, until a click
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
    page.get_by_label("Compare run 2", exact=True).click()  # a second click lets go
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
    page.locator("tr[data-row='3'] .picture").click()  # beside its target
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
    page.locator("#table th", has_text="PSNR").get_by_role("button").click()  # narrow pages show cards that sort
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
    assert "<td>axis0=1 axis1=2 axis2=3 axis3=4 axis4=5</td>" in html  # of the means
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
    assert thumbnail(tmp_path / "a.png", 640)["width"] == 80  # made anew, and not enlarged
    assert _thumbnail.cache_info().misses == 2
    assert thumbnail(tmp_path / "none.png", 640) is None
    (tmp_path / "bad.png").write_bytes(b"no picture")
    assert thumbnail(tmp_path / "bad.png", 640) is None
    for count in range(1, 2500, 7):  # the more runs, the smaller
        side = side_for(count)
        assert count * side**2 <= AREA
        assert side == SIDES[0] or count * SIDES[SIDES.index(side) - 1] ** 2 > AREA
