"""Tests of a run's page: what it contains, and how it behaves in a real browser."""

import base64
import io
import json
import math
import re
import shlex
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest
import torch
from browser import NARROW, WIDE
from brushexp_studio.view import read_painting
from films import pixels_of
from numpy.testing import assert_allclose, assert_array_equal
from omegaconf import OmegaConf
from PIL import Image, ImageColor
from scenes import random_strokes, with_shapes

from brushexp.errors import UserError
from brushexp.pages.drawings import error_map, histogram_chart, line_chart, rose_chart, swatches_of
from brushexp.pages.replay import FARTHEST_CANVAS_SIDES, LEVELS, pack_strokes, replay_of
from brushexp.pages.run_page import LARGEST_SIDE, embed_pixels, files_in, line_of, run_page, write_run_page
from brushexp.painting.finished import Finished
from brushexp.painting.reopen import export_job
from brushexp.results.runs import read_curves
from brushexp.results.stroke_table import measure_strokes
from brushexp.shading.light import Light, normals_of, shade_picture
from brushexp.strokes.bezier import closest_parameter, curve_of, drift_of, half_width_of, point_at, softness_of
from brushexp.strokes.catalogue import LATER_FIELDS, Strokes
from brushexp.strokes.storage import Saved, load_catalogue, save_catalogue
from brushexp.system.files import TEMPORARY, write_json, write_picture, write_text
from brushexp.tasks.paint import try_to_write_page

SIZE = (120, 160)
COUNT = 300
WRITTEN = "<script>alert(1)</script>\"'&amp;.png"
CONFIG = """
image: astronaut
steps: 30
renderer: {options}
loss: {{mse: {{weight: 1.0}}}}
"""
METRICS = {
    **{"psnr": 27.123, "ssim": 0.876, "l1": 0.0312, "perceptual": 0.2, "seconds": 12.3, "seconds_total": 15.0},
    **{"n_strokes": COUNT, "steps": 500, "device": "cpu", "status": "completed"},
    "anytime": [[0.0, 15.0], [1.0, 22.0], [2.0, 27.1]],
}


def saved_with(count: int, size: tuple[int, int] = SIZE, *, taper: float = 0.0, renderer: str = "analytic") -> Saved:
    strokes = random_strokes(count, size, width=(0.05, 0.4))
    strokes = with_shapes(replace(strokes, opacity=0.3 + 0.7 * strokes.opacity))
    depth = torch.randperm(count, generator=torch.Generator().manual_seed(3)).to(torch.int32)
    config = CONFIG.format(options=f"{{soft: 2.0, taper: {taper}}}" if renderer == "analytic" else "{}")
    return Saved(strokes, depth, size, torch.tensor([0.8, 0.7, 0.6]), renderer, config=config)


def page_of(saved: Saved, metrics: dict | None = None, command: str | None = None, **pictures) -> str:
    return run_page(Finished(export_job(saved), pictures, lambda: metrics or {}), name="x", command=command)


def page_from(folder: Path) -> Path:
    """Write a run's page from the files in its folder, and return its path."""
    return write_run_page(folder, read_painting(folder, export_job(load_catalogue(folder / "catalogue.h5"))))


def run_in(folder: Path, *, image: str = "astronaut", overrides: tuple[str, ...] = ("steps=30",)) -> Path:
    """Write the files of a run into a folder without painting, and return the folder."""
    saved = saved_with(COUNT)
    saved = replace(saved, config=saved.config.replace("astronaut", json.dumps(image)))
    painting = export_job(saved).picture()
    noise = np.random.default_rng(0).integers(-20, 21, painting.shape)
    target = (painting + noise).clip(0, 255).astype(np.uint8)
    (folder / "curves").mkdir(parents=True)
    (folder / ".hydra").mkdir()
    save_catalogue(folder / "catalogue.h5", saved)
    for name, picture in (("painting", painting), ("target", target), ("style", target[:50, :60])):
        write_picture(folder / f"{name}.png", picture)
    write_json(folder / "metrics.json", METRICS)
    rows = [f"{0.1 / k},{20 + k},{k},{10 * k}" for k in range(1, 40)]
    write_text(folder / "curves" / "metrics.csv", "\n".join(["loss/mse,psnr,seconds,step", *rows, ""]))
    write_text(folder / ".hydra" / "overrides.yaml", json.dumps([*overrides, "output=x"]))
    return folder


def test_files_of_a_run_are_those_that_stay_its_film_too(tmp_path):
    folder = run_in(tmp_path / "run")
    for name in (".hydra/files.txt", ".hydra/lock", f"{TEMPORARY[:-1]}0123.mp4", "report.html"):
        (folder / name).touch()

    def film():
        time.sleep(0.2)
        (folder / "timelapse.mp4").touch()

    with ThreadPoolExecutor(1) as beside:
        names = [file["name"] for file in files_in(folder, beside.submit(film))]
    assert names == [
        *("painting.png", "catalogue.h5", "timelapse.mp4", "target.png", "metrics.json", "curves/metrics.csv"),
        *(".hydra/overrides.yaml", "style.png"),
    ]


@pytest.fixture(scope="module")
def run(tmp_path_factory) -> Path:
    folder = run_in(tmp_path_factory.mktemp("page") / "run")
    page_from(folder)
    return folder


@pytest.fixture(scope="module")
def visited(run, opened):
    """Open the run's page, scroll to its lamp and its replay, and wait until both are ready."""
    watched = opened(run / "report.html")
    see(watched, "#light")
    watched.page.wait_for_selector("#light-stage[data-ready]")
    see(watched, "#replay")
    idle(watched)
    return watched


def see(watched, selector: str) -> None:
    watched.evaluate("selector => document.querySelector(selector).scrollIntoView({behavior: 'instant'})", selector)


def idle(watched, count: int | None = None) -> None:
    """Wait until the replay has finished painting and, if ``count`` is given, shows that number of strokes."""
    state = "" if count is None else f"[data-shown='{count}']"
    watched.page.wait_for_selector(f"#replay-stage[data-live=yes][data-busy=false]{state}")


def slide(watched, selector: str, value: float) -> None:
    """Move a slider as a pointer would."""
    move = """([selector, value]) => {
      const input = document.querySelector(selector);
      input.value = value;
      input.dispatchEvent(new Event("input"));
    }"""
    watched.evaluate(move, [selector, value])


def scrub(watched, count: int) -> None:
    slide(watched, "#scrubber", count)
    idle(watched, count)


def decoded(uri: str) -> np.ndarray:
    with Image.open(io.BytesIO(base64.b64decode(uri.partition(",")[2]))) as image:
        return np.asarray(image.convert("RGB"))


def pixels_in(watched, selector: str = ".replay-paint") -> np.ndarray:
    """Return the pixels of a canvas element."""
    return decoded(watched.evaluate("selector => document.querySelector(selector).toDataURL()", selector))


def point(watched, selector: str, x: float, y: float) -> None:
    """Move the pointer to a position in a picture, given as fractions of its width and height."""
    box = watched.page.locator(selector).bounding_box()
    watched.page.mouse.move(box["x"] + x * box["width"], box["y"] + y * box["height"])


def field_of(watched, name: str) -> str:
    return watched.page.locator(f"[data-field={name}]").text_content()


def test_a_page_shows_all_that_a_run_has_left_and_asks_nothing_of_any_other_place(run):
    html = (run / "report.html").read_text()
    for part in ("replay", "error", "curves", "strokes-section", "light", "settings"):
        assert f'<section id="{part}"' in html
    for part in ("27.12", "brushexp steps=30", 'alt="style"', "PSNR by time", "Loss mse"):
        assert part in html
    assert (
        "content=\"default-src 'none'; img-src data:; base-uri 'none'; form-action 'none'; style-src 'sha256-" in html
    )
    assert not re.search(r"(src|href)=[\"']?(https?:)?//", html)
    assert not re.search(r"<[^>]* (style|on\w+)=", re.sub(r"<script.*?</script>", "", html, flags=re.S))
    menu = re.findall(r'href="#([\w-]+)">([^<]+)</a>', html)[1:]  # the first link skips to the content
    assert [part for part, _ in menu] == ["replay", "light", "files", "measured", "settings"]
    for part, word in menu:
        assert f'id="{part}"' in html
        assert re.search(f"<h2[^>]*>{word}</h2>", html)
    figures = html.partition('<details class="measured"')[2].partition("</details>")[0]
    for part in ("figures", "error", "curves", "strokes-section"):
        assert f'<section id="{part}"' in figures, "what is measured opens on request"
    places = [html.index(f'id="{part}"') for part in ("painting", "replay", "light", "files", "measured", "settings")]
    assert places == sorted(places)
    assert places[-1] < html.index('alt="style"'), "other pictures come last"
    (run / "a b.txt").write_text("x")
    again = page_from(run).read_text()
    (run / "a b.txt").unlink()
    names = ["painting.png", "catalogue.h5", "metrics.json", "curves/metrics.csv", ".hydra/overrides.yaml", "a%20b.txt"]
    assert all(f'href="{name}" download' in again for name in names)
    assert 'href="report.html"' not in again
    assert page_from(run).read_text() == html, "the same run makes the same page"


def test_settings_name_plugins_sizes_and_what_was_typed_and_are_the_same_in_one_line(config):
    words = ["loss=[mse,width]", "loss.width.weight=0.5", "renderer=textured", "light=200,30", "optimizer=sgd"]
    resolved = OmegaConf.to_container(config(*words, "background='#102030'", "image=a b.png"), resolve=True)
    again = OmegaConf.to_container(config(*shlex.split(line_of(resolved))[1:]), resolve=True)
    assert again | {"output": resolved["output"]} == resolved
    renderer = "{_target_: brushexp.plugins.renderer.analytic.Analytic, soft: 2.0}"
    config = f"steps: 5\nseed: null\nrenderer: {renderer}\n1: {{2: 3}}\n"
    html = page_of(replace(saved_with(5), config=config), command="brushexp steps=5 renderer=analytic")
    text = re.sub(r"\s+", " ", re.sub(r"<[^>]*>", " ", html.partition("All settings")[2]))
    assert "steps 5 typed seed null renderer analytic typed renderer.soft 2.0 1.2 3" in text
    assert 'id="settings"' not in page_of(replace(saved_with(5), config=""))
    html = page_of(replace(saved_with(5), config="init: {_target_: brushexp.plugins.init.grid.Grid}\n"))
    assert html.count('"note": "Set by init=grid, so it says nothing') == 3
    assert "<code>init=grid</code>, not by the picture" in html
    assert "not by the picture" not in page_of(saved_with(5))


def test_what_is_not_known_is_left_out():
    html = page_of(saved_with(50))
    assert '<section id="replay"' in html
    assert '<section id="strokes-section"' in html
    for part in ("error", "curves", "light"):
        assert f'id="{part}"' not in html
        assert f'href="#{part}"' not in html
    assert "repeats the run" not in html
    nothing = replace(saved_with(1), strokes=Strokes.none(), depth=torch.zeros(0, dtype=torch.int32))
    html = page_of(nothing, painting=np.zeros((*SIZE, 3), np.uint8))
    assert "0 strokes" in html
    assert 'id="replay"' not in html
    html = page_of(saved_with(1, renderer="neural"), metrics={"psnr": None, "l1": 0.0})
    for part in ("1 stroke drawn by renderer=neural", "The only stroke is", "<code>renderer=neural</code>", "∞"):
        assert part in html


def test_the_head_of_a_page_is_in_words(tmp_path):
    folder = run_in(tmp_path / "run")
    lead = f"{COUNT} strokes, {SIZE[1]} × {SIZE[0]} pixels"
    assert f'<p class="lead">{lead}</p>' in page_from(folder).read_text()
    for recorded, words in {"look: oil": "In oil, ", "look: own": "", "x": ""}.items():
        (folder / ".hydra" / "hydra.yaml").write_text(f"hydra: {{runtime: {{choices: {{{recorded}}}}}}}\n")
        assert f'<p class="lead">{words}{lead}</p>' in page_from(folder).read_text()
    assert "3 strokes of a bristle brush, " in page_of(saved_with(3, renderer="textured"))


@pytest.mark.parametrize(("error", "words", "is_bug"), [
    (UserError("no room"), "report.html could not be written: no", False), (ZeroDivisionError(), "Traceback", True),
])  # fmt: skip
def test_a_run_is_not_lost_with_its_page(tmp_path, caplog, monkeypatch, error, words, is_bug):
    monkeypatch.setattr("brushexp.pages.run_page.page_in", Mock(side_effect=error))
    try_to_write_page(tmp_path, Finished(export_job(saved_with(3)), {}, lambda: {"status": "completed"}))
    assert words in caplog.text
    assert ("Traceback" in caplog.text) == is_bug


def test_damaged_files_are_left_out(tmp_path, caplog):
    folder = run_in(tmp_path / "run")
    whole = (folder / "painting.png").read_bytes()
    for damaged in (b"nothing", whole[: len(whole) // 2]):
        (folder / "painting.png").write_bytes(damaged)
        assert 'id="painting"' not in page_from(folder).read_text()
        assert "painting.png is left out" in caplog.text
        caplog.clear()
    path = folder / "curves" / "metrics.csv"
    path.write_bytes(b"step,psnr\n1,20,30\n2\n3,x\n")  # too many, too few, not a number
    result = read_curves(path)
    assert result["step"] == [1, 2, 3]
    assert_array_equal(result["psnr"], [20, math.nan, math.nan])
    path.write_bytes(b"step,psnr\n\xff\x00\n")
    assert read_curves(path) == {}


def test_packed_strokes_are_the_strokes_and_those_far_away_do_not_coarsen_the_others():
    saved = saved_with(200)
    measures = measure_strokes(saved.strokes, saved.depth, saved.size)
    packed = replay_of(export_job(saved), measures)
    data = base64.b64decode(packed["data"])
    assert len(data) == 44 * 200
    result, at = {}, 800
    for name, each, low, high in packed["columns"]:
        shares = np.frombuffer(data, "<u2", 200 * each, at).reshape(200, each) / LEVELS
        result[name], at = low + shares * (high - low), at + 400 * each
    order = saved.depth.argsort().numpy()
    assert_array_equal(np.frombuffer(data, "<u4", 200), order)
    assert_allclose(result["points"].reshape(200, 3, 2), curve_of(saved.strokes).numpy()[order], atol=0.01)
    assert_allclose(2 * result["half"][:, 0], measures.width[order], atol=0.001)
    assert_allclose(result["softness"][:, 0], softness_of(saved.strokes).numpy()[order], atol=0.001)
    assert_allclose(result["widening"][:, 0], saved.strokes.widening.numpy()[order], atol=1e-4)
    assert_allclose(result["drift"], drift_of(saved.strokes).numpy()[order], atol=1e-4)
    assert_allclose(result["paint"], saved.strokes.color.numpy()[order], atol=1e-4)
    assert_allclose(result["layer"][:, 0].round(3).sum(), 200 - 1, atol=2)  # a third each of 0, 1 and 2
    saved.strokes.position[0], saved.strokes.width[1] = 1e6, 1e3
    packed = replay_of(export_job(saved), measure_strokes(saved.strokes, saved.depth, saved.size))
    highest = {name: high for name, _, _, high in packed["columns"]}
    assert highest["points"] <= (1 + FARTHEST_CANVAS_SIDES) * max(SIZE)
    assert highest["half"] <= FARTHEST_CANVAS_SIDES * max(SIZE)


def test_strokes_are_packed_with_no_more_than_their_renderer_draws():
    packed = pack_strokes(export_job(saved_with(5, renderer="neural")))
    assert not {name for name, *_ in packed["columns"]} & {*LATER_FIELDS}


def test_pictures_errors_and_colours_are_those_of_the_painting():
    target = np.zeros((4, 6, 3), np.uint8)
    painting = target.copy()
    painting[1, 2] = (3, 6, 9)
    result = error_map(painting, target)
    assert result["mean"] == pytest.approx(6 / 24)
    assert (result["top"], result["above"]) == (8, 0)
    assert result["below"] == [("half", 0), ("90 %", 0), ("99 %", 6), ("all", 6)]
    assert_array_equal(result["pixels"][0, 0], (0, 0, 4))
    assert result["pixels"][1, 2].sum() > 300
    assert error_map(target, target)["mean"] == 0
    colors = np.repeat([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [1.0, 1.0, 1.0]], [10, 20, 30], axis=0)
    shares = [(swatch["color"], round(swatch["share"], 3)) for swatch in swatches_of(colors, np.ones(60))]
    assert shares == [("#0000ff", 0.333), ("#ff0000", 0.167), ("#ffffff", 0.5)]
    assert swatches_of(colors, np.zeros(60)) == []
    noise = np.random.default_rng(0).integers(0, 256, (1000, 2000, 3), dtype=np.uint8)
    large, small = embed_pixels(noise), embed_pixels(noise[:50, :70])
    assert large["source"].startswith("data:image/jpeg")
    assert decoded(large["source"]).shape == (LARGEST_SIDE // 2, LARGEST_SIDE, 3)
    assert_array_equal(decoded(small["source"]), noise[:50, :70])


def test_charts_need_something_to_show():
    for x, y in (([1], [2]), ([1, 2], [math.nan, 2]), ([], []), ([3, 3], [1, 2])):
        assert line_chart("x", x, y, "steps") is None
    assert line_chart("x", [1, 2, 3], [3, math.nan, 5], "steps")["y"] == [3, 5]
    assert len(line_chart("x", range(5000), range(5000), "steps")["x"]) == 400
    assert histogram_chart("x", np.array([math.nan]), "px") is None
    assert histogram_chart("x", np.zeros(5), "px")["counts"][0] == 5
    assert sum(histogram_chart("x", np.random.default_rng(1).exponential(5, 1000), "px")["counts"]) == 1000
    assert rose_chart("x", np.array([math.nan]), np.ones(1)) is None
    shares = rose_chart("x", np.array([0.0, 3.13, math.pi / 2]), np.ones(3))["shares"]
    assert shares[::9] == pytest.approx([2 / 3, 1 / 3])


def test_the_painting_can_be_seen_alone_at_any_size(visited):
    page = visited.page
    page.get_by_role("button", name="Show it alone").click()
    alone = page.get_by_role("dialog", name="The picture alone")
    picture = alone.get_by_alt_text("painting")
    alone.get_by_text("%").wait_for()
    fits = picture.bounding_box()["width"]
    assert fits > SIZE[1], "it is as large as the window"
    alone.get_by_role("button", name="Larger").click()
    assert picture.bounding_box()["width"] == pytest.approx(1.5 * fits, rel=0.05)
    page.keyboard.press("0")
    assert picture.bounding_box()["width"] == pytest.approx(fits, rel=0.01)
    page.keyboard.press("Escape")
    assert not alone.is_visible()


def test_a_visitor_compares_the_painting_with_its_target_and_reads_the_charts(visited):
    wipe = visited.page.locator(".hero .wipe")

    def split() -> float:
        return float(wipe.evaluate("e => getComputedStyle(e).getPropertyValue('--split')").rstrip("%"))

    wipe.locator("input").press("Home")
    assert split() == 0
    wipe.scroll_into_view_if_needed()
    point(visited, ".hero .wipe", 0.5, 0.5)
    visited.page.mouse.down()
    point(visited, ".hero .wipe", 0.25, 0.6)
    visited.page.mouse.up()
    assert split() == pytest.approx(25, abs=0.5)
    marks = "() => [...document.querySelectorAll('.chart')].map(e => e.querySelectorAll('.line, .bin').length)"
    assert visited.evaluate(marks) == [1, 1, 1, 28, 28, 28, 28, 28, 36]
    titles = visited.page.locator(".chart").nth(3).locator("title").all_text_contents()
    assert sum(int(re.search(r": (\d+) strokes", title)[1]) for title in titles) == COUNT
    assert visited.page.locator(".chart .axis-name").nth(5).text_content() == "logarithmic"
    ticks = """() => {
      const { linear, scale } = brushexp.chart;
      const found = [];
      for (let low = -7; low < 6; low += 0.37) for (let span = -6; span < 9; span += 0.53) {
        for (const [start, kind] of [[10 ** low, scale], [-(10 ** low), linear], [0, linear]]) {
          const made = kind([start, start + 10 ** span], 50, 404);
          const places = made.ticks.map(([value]) => made.place(value));
          const fits = places.every((x) => x > 49.9 && x < 404.1);
          if (!fits || places.length < 1 || places.length > 9) found.push([start, span]);
        }
      }
      return found;
    }"""
    assert visited.evaluate(ticks) == []


@pytest.mark.parametrize(
    ("renderer", "taper", "worst"), [("analytic", 0.0, 1), ("analytic", 0.8, 1), ("textured", 0, 10)]
)
def test_the_replay_ends_as_the_painting_and_its_lamp_goes_on_at_the_end(renderer, taper, worst, opened, tmp_path):
    saved = saved_with(200, (300, 400), taper=taper, renderer=renderer)
    width = torch.where(torch.arange(200) % 4 == 0, 0.008, saved.strokes.width)  # thin strokes fade
    saved = replace(saved, strokes=replace(saved.strokes, scale=4 * saved.strokes.scale, width=width))
    lamp = Light(depth=1.5) if renderer == "textured" else Light()
    saved = replace(saved, config="light: {depth: 1.5}" if lamp.depth else saved.config)
    job = export_job(saved)
    flat, painting = replace(job, light=Light()).picture(), job.picture()
    pictures = {"flat": flat, "painting": painting} if lamp.depth else {}
    write_text(tmp_path / "report.html", page_of(saved, **pictures))
    watched = opened(tmp_path / "report.html", (1440, round(300 / 0.64)))  # one pixel of the page per painted pixel
    see(watched, "#replay")
    idle(watched)
    assert abs(pixels_in(watched).shape[0] - 300) <= 1

    def error(picture: np.ndarray) -> float:
        return np.square(np.asarray(Image.fromarray(pixels_in(watched)).resize((400, 300)), float) - picture).mean()

    lit = error(painting)
    assert lit < worst
    if lamp.depth:
        scrub(watched, 199)
        assert error(flat) < 2 * worst
        assert error(painting) > 1.5 * lit
    assert not watched.errors


def test_a_visitor_replays_strokes_back_and_forth_and_leaves_layers_out(visited):
    pictures = {}
    for count in (120, 299, 121, 120, 0, 299):  # the last starts from a key frame
        scrub(visited, count)
        picture = pixels_in(visited)
        assert_array_equal(picture, pictures.setdefault(count, picture))
    assert (pictures[120] != pictures[121]).any()
    assert_array_equal(np.unique(pictures[0].reshape(-1, 3), axis=0), [[204, 179, 153]])
    play = visited.page.locator("#play")
    visited.page.select_option("#speed", "10")
    play.click()
    visited.page.wait_for_selector(f"#replay-stage[data-playing=false][data-shown='{COUNT}']")
    play.click()  # from the beginning
    assert play.text_content() == "Pause"
    play.click()
    assert play.text_content() == "Play"
    assert int(visited.page.locator("#scrubber").input_value()) < COUNT
    order = saved_with(COUNT).depth.argsort().tolist()
    scrub(visited, 50)
    stage = visited.page.locator("#replay-stage")
    for key, count in (("ArrowRight", 51), ("ArrowLeft", 50), ("Shift+ArrowRight", 150), ("Home", 0), ("End", COUNT)):
        stage.press(key)
        idle(visited, count)
        if count:
            assert field_of(visited, "number") == str(order[count - 1])
    stage.press("Space")
    assert stage.get_attribute("data-playing") == "true"
    stage.press("Space")
    scrub(visited, COUNT)
    whole = pixels_in(visited)
    boxes = [visited.page.locator(f"[data-layer={layer}]") for layer in ("large", "medium", "small")]
    for box in boxes:
        box.uncheck()
        idle(visited)
        assert (pixels_in(visited) != whole).any()
    assert len(np.unique(pixels_in(visited).reshape(-1, 3), axis=0)) == 1
    for box in boxes:
        box.check()
    idle(visited)
    assert_array_equal(pixels_in(visited), whole)


def oracle(saved: Saved, points: np.ndarray) -> list[int | None]:
    """Return the top stroke at each point, or None where it depends on rounding."""
    curve, half = curve_of(saved.strokes), half_width_of(saved.strokes)
    place = torch.as_tensor(points, dtype=torch.float32)[None].expand(len(half), -1, -1)
    t = closest_parameter(curve[:, None], place)
    away = (point_at(curve[:, None], t) - place).norm(dim=-1)
    half = half[:, None] * (1 + saved.strokes.widening[:, None] * (2 * t - 1))
    result: list[int | None] = []
    for margin in (half - away).T:
        sure, maybe = (margin > 0.3).nonzero().ravel(), (margin.abs() <= 2).nonzero().ravel()
        top = max(sure.tolist(), key=lambda k: int(saved.depth[k]), default=None)
        doubt = top is None or any(saved.depth[k] > saved.depth[top] for k in maybe.tolist() if margin[k] <= 0.3)
        result.append(None if doubt else top)
    return result


def test_pointing_tells_the_uppermost_stroke(visited):
    saved = saved_with(COUNT)
    scrub(visited, COUNT)
    see(visited, "#replay")
    size = np.array([SIZE[1], SIZE[0]])
    points = np.random.default_rng(2).uniform([2, 2], size - 2, (150, 2))
    expected = [(*xy / size, k) for xy, k in zip(points, oracle(saved, points), strict=True) if k is not None]
    assert len(expected) > 15
    measures = measure_strokes(saved.strokes, saved.depth, saved.size)
    for x, y, stroke in expected[:15]:
        point(visited, "#replay-stage", x, y)
        assert field_of(visited, "number") == str(stroke)
        assert field_of(visited, "depth") == f"{int(saved.depth[stroke]) + 1} of {COUNT}"
        assert field_of(visited, "length") == f"{measures.length[stroke]:.1f} px"
        assert field_of(visited, "width") == f"{measures.width[stroke]:.1f} px"
        middle, drift = saved.strokes.color[stroke], drift_of(saved.strokes)[stroke]
        ends = [np.array(ImageColor.getrgb(color)) for color in field_of(visited, "colour").split(" to ")]
        assert_allclose(ends, 255 * torch.stack([middle - drift, middle + drift]), atol=1)
    assert pixels_in(visited, ".replay-over").any()
    card = visited.page.locator("#stroke")
    visited.page.mouse.move(2, 2)
    assert card.get_attribute("data-empty") == "true"
    x, y, stroke = expected[0]
    point(visited, "#replay-stage", x, y)
    visited.page.mouse.down()  # a tap keeps it until Escape
    visited.page.mouse.up()
    visited.page.mouse.move(2, 2)
    assert field_of(visited, "number") == str(stroke)
    assert card.get_attribute("data-empty") == "false"
    visited.page.locator("#replay-stage").press("Escape")
    assert card.get_attribute("data-empty") == "true"


def test_the_lamp_follows_the_pointer_and_its_light_is_that_of_the_program(visited, run):
    data = json.loads(visited.page.locator("#heights").text_content())
    levels = decoded(data["source"]).astype(np.float32)
    height = (256 * levels[..., 0] + levels[..., 1]) / 65535 * data["top"]
    color = pixels_of(run / "painting.png").transpose(2, 0, 1).astype(np.float32) / 255
    for name, value in {"azimuth": 200, "elevation": 35, "depth": 1.5, "gloss": 0.4}.items():
        slide(visited, f"#{name}", value)
    visited.page.wait_for_timeout(100)
    expected = shade_picture(color, normals_of(height, 1.5), Light(200, 35, gloss=0.4)).transpose(1, 2, 0) * 255
    away = np.abs(pixels_in(visited, "#light-stage canvas") - expected)
    assert away.mean() < 1
    assert away.max() < 6
    assert visited.page.locator("output[for=azimuth]").text_content() == "200°"
    see(visited, "#light")
    point(visited, "#light-stage", 0.8, 0.5)
    visited.page.mouse.down()
    visited.page.mouse.up()
    assert float(visited.page.locator("#azimuth").input_value()) == pytest.approx(90, abs=1)


NAMELESS = """() => [...document.querySelectorAll("button, input, select, [tabindex='0'], img, [role=img]")]
    .filter((e) => !(e.getAttribute("aria-label") || e.labels?.length || e.textContent.trim()))
    .filter((e) => !e.hasAttribute("alt"))
    .map((e) => e.outerHTML.slice(0, 80))"""


TOO_FAINT = """() => {
  const levels = (text) => text.match(/[\\d.]+/g).map(Number);
  const linear = (c) => (c <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4);
  const light = ([r, g, b]) => 0.2126 * linear(r / 255) + 0.7152 * linear(g / 255) + 0.0722 * linear(b / 255);
  const ground = (element) => {
    for (let e = element; e; e = e.parentElement) {
      const color = levels(getComputedStyle(e).backgroundColor);
      if (color.length < 4 || color[3] > 0.5) return color;
    }
    return [255, 255, 255];
  };
  const found = [];
  for (const element of document.querySelectorAll("main *, header *, footer *")) {
    const text = [...element.childNodes].some((node) => node.nodeType === 3 && node.textContent.trim());
    if (!text || !element.getClientRects().length || element.closest("script, .unseen, option")) continue;
    const style = getComputedStyle(element);
    const ink = light(levels(element.namespaceURI.endsWith("svg") ? style.fill : style.color));
    const [high, low] = [ink, light(ground(element))].sort((a, b) => b - a);
    const contrast = (high + 0.05) / (low + 0.05);
    if (contrast < 4.5) found.push(`${element.textContent.trim().slice(0, 20)}: ${contrast.toFixed(2)}`);
  }
  return found;
}"""


def test_it_fits_every_screen_can_be_read_and_printed(visited, opened, tmp_path):
    page, paper = visited.page, "getComputedStyle(document.body).backgroundColor"
    visited.evaluate("() => document.querySelectorAll('details').forEach((one) => { one.open = true; })")
    for width, height in (NARROW, WIDE):
        page.set_viewport_size({"width": width, "height": height})
        for scheme in ("light", "dark"):
            page.emulate_media(color_scheme=scheme)
            assert not visited.is_too_wide()
            assert visited.evaluate(TOO_FAINT) == []
    dark = visited.evaluate(paper)
    toggle = page.get_by_role("button", name="Dark colours")
    toggle.click()
    assert visited.evaluate(paper) != dark
    toggle.click()  # dark is now chosen explicitly, not only by the system
    assert (visited.evaluate(paper), toggle.get_attribute("aria-pressed")) == (dark, "true")
    page.click("[data-copy]")
    page.wait_for_selector("[data-copy]:has-text('Copied')")
    page.emulate_media(media="print")
    levels = "['color', 'backgroundColor'].map(k => getComputedStyle(document.body)[k].match(/[0-9]+/g).slice(0, 3))"
    ink, ground = visited.evaluate(levels)
    assert max(map(int, ink)) < 80
    assert min(map(int, ground)) > 240
    assert not page.locator("#play").is_visible()
    page.emulate_media(media="screen")
    assert visited.evaluate(NAMELESS) == []
    names = visited.evaluate("() => [...document.querySelectorAll('[id]')].map((e) => e.id)")
    assert len(set(names)) == len(names)
    assert not visited.errors
    assert not visited.foreign
    for size in ((400, 4), (1, 90)):  # long and narrow pictures fit into the window
        pictures = dict.fromkeys(("target", "painting"), np.zeros((*size, 3), np.uint8))
        write_text(tmp_path / "a.html", page_of(saved_with(20, size), **pictures))
        watched = opened(tmp_path / "a.html")
        assert not watched.is_too_wide()
        heights = watched.evaluate("[...document.querySelectorAll('.stage')].map(e => e.clientHeight)")
        assert max(heights) <= WIDE[1]
        assert not watched.errors


def test_the_policy_runs_no_scripts_in_names_and_nothing_that_is_not_in_the_page(opened, tmp_path):
    folder = run_in(tmp_path / "x", image=WRITTEN, overrides=(f"image={WRITTEN}", "steps=<b onclick=alert(1)>"))
    watched = opened(page_from(folder))
    assert watched.page.locator("h1").text_content() == "script>\"'&amp;.png"  # the file's name, after the last slash
    assert "<b onclick=alert(1)>" in watched.page.locator(".command code").first.text_content()
    assert watched.page.locator("main b").count() == 0
    assert not watched.errors
    add = """() => {
      document.body.append(Object.assign(document.createElement("img"), { src: "https://example.org/x.png" }));
      document.body.append(Object.assign(document.createElement("script"), { textContent: "window.evil = 1" }));
    }"""
    watched.evaluate(add)
    watched.page.wait_for_timeout(100)
    assert watched.evaluate("() => window.evil") is None
    assert len([error for error in watched.errors if "Content Security Policy" in error]) >= 2
    page = opened(folder / "report.html", java_script_enabled=False).page
    assert page.locator("noscript p").is_visible()
    for gone in ("#replay", "#light", "[data-copy]", ".nav [href='#replay']"):
        assert not page.locator(gone).first.is_visible(), gone
