"""The page of a sweep in a real browser: sorted, filtered, compared, pointed at; and what is in it."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from browser import NARROW, WIDE
from sweeps import collect, make_run

from brushexp.pages.sweep_page import AREA, SIDES, _encoded, side_for, sweep_page, thumbnail, write_sweep_page
from brushexp.results.pareto import front_table
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


@pytest.fixture
def page(sweep, opened):
    """The page of the sweep, as it is opened."""
    return opened(sweep).page


def order(page) -> list[str]:
    """The names of the shown runs, from the top."""
    return page.evaluate("[...document.querySelectorAll('#table tr:not([hidden]) .name')].map(e => e.dataset.sort)")


def data_in(html: str) -> dict:
    return json.loads(re.search(r'<script type="application/json" id="data">(.*?)</script>', html, re.S)[1])


def test_a_head_sorts_with_a_click_and_with_the_keyboard(page):
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


def test_filters_leave_what_fits_and_say_how_many(page):
    page.locator("[popovertarget]", has_text="steps").press("Enter")
    page.get_by_label("100", exact=True).check()
    page.get_by_label("1500", exact=True).check()
    assert order(page) == ["0", "2", "3", "5"]
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


def test_two_runs_stand_side_by_side_under_the_wipe(page):
    assert page.get_by_label("Compare run 6", exact=True).is_disabled()  # it has no picture
    for name in ("1", "1", "2", "4"):  # a second click lets go
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


def test_points_are_walked_with_the_keyboard_and_tell_their_command(page):
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


def test_the_front_is_that_of_the_table_and_any_setting_can_be_plotted_against(sweep, page):
    table = front_table(collect(sweep.parent))
    labels = page.locator(".point.on").evaluate_all("found => found.map(e => e.getAttribute('aria-label'))")
    assert {label.partition(":")[0] for label in labels} == set(table["overrides"][table["front_psnr"]])
    assert all(label.endswith("on the front") for label in labels)
    page.locator("#along").select_option("axis:loss")
    page.locator("#up").select_option("ssim")
    assert {"mse", "ssim", "SSIM"} <= set(page.locator("#points .axes text").all_text_contents())
    assert page.locator("#points .point").count() == 6


def test_of_many_settings_those_that_led_are_coloured(tmp_path, opened):
    for k in range(12):
        curve = [[0.1, 10], [1 + k, 20 + k]] if k in (0, 11) else [[0.1, 5], [2, 9]]
        make_run(tmp_path, {"steps": str(k)}, psnr=float(curve[1][1]), seconds=1.0 + k, anytime=curve)
    watched = opened(page_of(tmp_path))
    assert watched.page.locator("#curves .curve").count() == 12
    assert watched.page.locator("#curves .curve.other").count() == 12 - watched.page.locator("#legend li").count() > 5
    assert "steps=11" in watched.page.locator("#legend").text_content()
    assert "ahead at some time" in watched.page.locator("#curves-say").text_content()


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


def test_what_users_typed_stays_text(sweep, opened):
    watched = opened(sweep)
    row = watched.page.locator("tr[data-row='6']")
    assert row.locator(".error").text_content() == f"{EVIL} is no colour"
    assert row.locator("td.repeat code").text_content() == f"brushexp 'background={EVIL}'"
    watched.page.locator("[popovertarget]", has_text="background").click()
    watched.page.locator(".choices .chip", has_text="script>").click()
    assert order(watched.page) == ["6"]
    assert watched.page.title() == "sweep & more – brushexp"
    assert not watched.errors
    html = sweep.read_text()
    assert EVIL not in html
    assert 'http-equiv="Content-Security-Policy" content="default-src \'none\'; img-src data:;' in html


def test_seeds_have_means(tmp_path, opened):
    for k, (steps, seed, psnr) in enumerate((("1", "0", 20.0), ("1", "1", 22.0), ("2", "0", 30.0), ("2", "1", 31.0))):
        make_run(tmp_path, {"steps": steps, "seed": seed}, color=50, psnr=psnr, seconds=1.0 + k)
    page = opened(page_of(tmp_path)).page
    assert page.locator("#means tbody tr").nth(0).locator("td").all_text_contents()[:3] == ["1", "2", "21.00 ± 1.41"]
    page.locator("#means th", has_text="PSNR").get_by_role("button").click()
    assert page.locator("#means tbody td").first.text_content() == "2"
    assert page.locator(".point").count() == 2
    told = page.locator(".point").first.get_attribute("aria-label")
    assert "PSNR, dB 21, optimisation, s 1.5, mean of 2 runs" in told
    assert page.locator("#paired tbody tr").count()
    names = page.eval_on_selector_all("[id]", "found => found.map(one => one.id)")
    assert len(names) == len(set(names))


def test_pictures_of_two_targets_are_not_plotted_together(tmp_path, opened):
    for k, image in enumerate(("a.png", "a.png", "b.png", "b.png")):
        chosen, grey = {"image": image, "steps": str(k % 2)}, ord(image[0])
        make_run(tmp_path, chosen, target=grey, color=50, psnr=20.0 + k, seconds=1.0 + k)
    watched = opened(page_of(tmp_path))
    assert watched.page.locator(".point").count() == 2
    watched.page.locator("#of-picture").select_option("1")
    assert watched.evaluate("[...document.querySelectorAll('.point')].map(e => e.dataset.group)") == ["2", "3"]
    assert watched.page.locator(".targets figure").count() == 2


def test_of_an_album_paintings_come_first_and_a_click_puts_one_beside_its_target(tmp_path, opened):
    for k, image in enumerate(("a.png", "b.png", "c.png")):
        make_run(tmp_path, {"image": image, "look": "ink"}, target=ord(image[0]), color=50, psnr=20.0 + k, seconds=1.0)
    watched = opened(page_of(tmp_path))
    assert "as-cards" in watched.page.locator("#runs").get_attribute("class")
    shown = watched.page.locator("img").evaluate_all("all => all.map(one => one.alt.split(' ')[0])")
    assert [name for name in shown if name in ("run", "target:")] == ["run"] * 3 + ["target:"] * 3
    watched.page.locator("button.picture").nth(1).click()
    sides = [watched.page.locator(f"#{side}").input_value() for side in ("left", "right")]
    assert (sides, watched.errors, watched.page.locator("#plots").count()) == (["target 1", "run 1"], [], 0)


def test_sweeps_of_other_tasks_and_of_one_failed_run_have_a_page_without_pictures(tmp_path, opened):
    for k, width in enumerate(("16", "32", "64")):
        make_run(tmp_path, {"renderer.width": width}, l2=0.1 / (k + 1))
    watched = opened(page_of(tmp_path))
    assert watched.page.locator("#plots-head").text_content() == "What the settings do"
    assert watched.page.locator(".point").count() == 3
    assert watched.page.locator(".no-picture").count() == 3
    assert not watched.errors
    (tmp_path / "0" / "metrics.json").unlink()
    make_run(tmp_path / "0", {}, name="0", status="failed", error="no")
    watched = opened(page_of(tmp_path / "0"))
    assert (watched.page.locator("#plots").count(), order(watched.page), watched.errors) == (0, ["0"], [])


def test_links_lead_from_where_the_page_is(tmp_path):
    make_sweep(tmp_path / "sweep?")
    (tmp_path / "comparison").mkdir()
    html = sweep_page(tmp_path / "comparison", gather([tmp_path / "sweep?"], tmp_path / "comparison"))
    assert '<a href="../sweep%3F/2/report.html">' in html
    assert [row["name"] for row in data_in(html)["rows"]] == list("0123456")


def test_pictures_are_encoded_once(tmp_path):
    write_picture(tmp_path / "a.png", np.zeros((100, 700, 3), np.uint8))
    _encoded.cache_clear()
    first = thumbnail(tmp_path / "a.png", 640)
    assert (first["width"], first["height"]) == (640, 91)
    assert thumbnail(tmp_path / "a.png", 640) is first
    write_picture(tmp_path / "a.png", np.zeros((100, 80, 3), np.uint8))
    assert thumbnail(tmp_path / "a.png", 640)["width"] == 80  # made anew, and not enlarged
    assert _encoded.cache_info().misses == 2
    assert thumbnail(tmp_path / "none.png", 640) is None
    (tmp_path / "bad.png").write_bytes(b"no picture")
    assert thumbnail(tmp_path / "bad.png", 640) is None
    for count in range(1, 2500, 7):  # the more runs, the smaller
        side = side_for(count)
        assert count * side**2 <= AREA
        assert side == SIDES[0] or count * SIDES[SIDES.index(side) - 1] ** 2 > AREA
