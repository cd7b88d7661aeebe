"""The page of a run: what is in it, and that it works in a real browser."""

import base64
import io
import json
import math
import re
import shlex
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from browser import NARROW, WIDE, browser, opened  # noqa: F401
from numpy.testing import assert_allclose, assert_array_equal
from PIL import Image
from scenes import random_strokes

from brushexp.analysis.columns import measure_strokes
from brushexp.app.tasks import paint
from brushexp.errors import UserError
from brushexp.painting.outputs import export_job, renderer_of
from brushexp.plugins.export.png import pixels
from brushexp.registry import build_named
from brushexp.results.page.charts import histogram_chart, line_chart, rose_chart
from brushexp.results.page.error_map import error_map
from brushexp.results.page.html import LARGEST_SIDE, data_uri, page, picture_uri
from brushexp.results.page.replay import FARTHEST, STEPS, replay_of
from brushexp.results.page.run import read_curves, run_page, write_run_page
from brushexp.results.page.swatches import swatches_of
from brushexp.shading.light import Light, normals_of, shaded
from brushexp.strokes.bezier import closest_parameter, curve_of, half_width_of, point_at
from brushexp.strokes.catalogue import Strokes
from brushexp.strokes.storage import Saved, save_catalogue
from brushexp.system.files import write_json, write_picture, write_text

SIZE = (120, 160)
WRITTEN = "<script>alert(1)</script>\"'&amp;.png"
CONFIG = """
image: astronaut
steps: 30
renderer: {{_target_: x, soft: 2.0, taper: {taper}}}
loss: {{mse: {{weight: 1.0}}}}
"""
METRICS = {
    **{"psnr": 27.123, "ssim": 0.876, "l1": 0.0312, "perceptual": 0.2, "seconds": 12.3, "seconds_total": 15.0},
    **{"n_strokes": 300, "steps": 500, "device": "cpu", "status": "completed"},
    "anytime": [[0.0, 15.0], [1.0, 22.0], [2.0, 27.1]],
}


def saved_with(count: int, size: tuple[int, int] = SIZE, *, taper: float = 0.0, renderer: str = "analytic") -> Saved:
    strokes = random_strokes(count, size, width=(0.05, 0.4))
    strokes = replace(strokes, opacity=0.3 + 0.7 * strokes.opacity)
    return Saved(
        strokes=strokes,
        depth=torch.randperm(count, generator=torch.Generator().manual_seed(3)).to(torch.int32),
        size=size,
        background=torch.tensor([0.8, 0.7, 0.6]),
        renderer=renderer,
        renderer_hash="",
        seed=0,
        config=CONFIG.format(taper=taper),
    )


def painting_of(saved: Saved) -> np.ndarray:
    return pixels(export_job(saved, renderer_of(saved), build_named("blend", "tiled", {}), saved.renderer))


def noisy(picture: np.ndarray) -> np.ndarray:
    noise = np.random.default_rng(0).integers(-20, 21, picture.shape)
    return (picture + noise).clip(0, 255).astype(np.uint8)


def run_in(folder: Path, *, image: str = "astronaut", overrides: tuple[str, ...] = ("steps=30",)) -> Path:
    """What a run leaves, without the run."""
    saved = saved_with(300)
    saved = replace(saved, config=saved.config.replace("astronaut", json.dumps(image)))
    painting = painting_of(saved)
    (folder / "curves").mkdir(parents=True)
    (folder / ".hydra").mkdir()
    save_catalogue(folder / "catalogue.h5", saved)
    write_picture(folder / "painting.png", painting)
    write_picture(folder / "target.png", noisy(painting))
    write_picture(folder / "style.png", noisy(painting)[:50, :60])
    write_json(folder / "metrics.json", METRICS)
    rows = [f"{0.1 / k},{20 + k},{k},{10 * k}" for k in range(1, 40)]
    write_text(folder / "curves" / "metrics.csv", "\n".join(["loss/mse,psnr,seconds,step", *rows, ""]))
    write_text(folder / ".hydra" / "overrides.yaml", json.dumps([*overrides, "output=x"]))
    return folder


@pytest.fixture(scope="module")
def run(tmp_path_factory) -> Path:
    folder = run_in(tmp_path_factory.mktemp("page") / "run")
    write_run_page(folder)
    return folder


@pytest.fixture(scope="module")
def shown(run, opened):  # noqa: F811
    """The page of the run, with all of it once in view."""
    watched = opened(run / "report.html", still=True)  # else the page may still be scrolling when it is pointed at
    see(watched, "#light")
    watched.page.wait_for_selector("#light-stage[data-ready]")
    see(watched, "#replay")
    idle(watched)
    return watched


def see(watched, selector: str) -> None:
    watched.evaluate("selector => document.querySelector(selector).scrollIntoView({behavior: 'instant'})", selector)


def idle(watched) -> None:
    watched.page.wait_for_selector("#replay-stage[data-live=yes][data-busy=false]")


def slide(watched, selector: str, value: float) -> None:
    """Move a slider, as a pointer would."""
    move = """([selector, value]) => {
      const input = document.querySelector(selector);
      input.value = value;
      input.dispatchEvent(new Event("input"));
    }"""
    watched.evaluate(move, [selector, value])


def scrub(watched, count: int) -> None:
    slide(watched, "#scrubber", count)
    watched.page.wait_for_selector(f"#replay-stage[data-shown='{count}'][data-busy=false]")


def seen(watched, selector: str = ".replay-paint") -> np.ndarray:
    """Pixels of a canvas."""
    text = watched.evaluate("selector => document.querySelector(selector).toDataURL()", selector)
    with Image.open(io.BytesIO(base64.b64decode(text.partition(",")[2]))) as image:
        return np.asarray(image.convert("RGB"))


def hover(watched, x: float, y: float, size: tuple[int, int] = SIZE) -> None:
    """Point at a place of the painting, in its pixels."""
    box = watched.page.locator("#replay-stage").bounding_box()
    watched.page.mouse.move(box["x"] + box["width"] * x / size[1], box["y"] + box["height"] * y / size[0])


def field_of(watched, name: str) -> str:
    return watched.page.locator(f"[data-field={name}]").text_content()


def psnr(a: np.ndarray, b: np.ndarray) -> float:
    return 10 * math.log10(255**2 / ((a.astype(float) - b.astype(float)) ** 2).mean())


# ---- what is in the page ----


def test_a_page_shows_all_that_a_run_has_left_and_asks_nothing_of_any_other_place(run):
    html = (run / "report.html").read_text()
    for part in ("replay", "error", "curves", "strokes-section", "light", "settings"):
        assert f'<section id="{part}"' in html
    for part in ("27.12", "python run.py steps=30", 'alt="style"', "PSNR by time", "Loss mse"):
        assert part in html
    assert "default-src 'none'; img-src data:; style-src 'sha256-" in html
    assert not re.search(r"(src|href)=[\"']?(https?:)?//", html)
    assert not re.search(r"<[^>]* (style|on\w+)=", re.sub(r"<script.*?</script>", "", html, flags=re.S))
    assert write_run_page(run).read_text() == html  # the same run makes the same page


def test_a_catalogue_alone_makes_a_page_without_what_is_not_known():
    html = run_page(saved_with(50), name="somewhere.h5")
    assert '<section id="replay"' in html
    assert '<section id="strokes-section"' in html
    for part in ("error", "curves", "light"):
        assert f'id="{part}"' not in html
        assert f'href="#{part}"' not in html
    assert "repeats the run" not in html


def test_other_catalogues_make_pages_too():
    nothing = replace(saved_with(1), strokes=Strokes.none(), depth=torch.zeros(0, dtype=torch.int32))
    html = run_page(nothing, name="nothing", pictures={"painting": np.zeros((*SIZE, 3), np.uint8)})
    assert "0 strokes" in html
    assert 'id="replay"' not in html
    html = run_page(saved_with(1, renderer="textured"), name="one", metrics={"psnr": None, "l1": 0.0})
    for part in ("1 stroke on", "The only stroke is", "<code>renderer=textured</code>", "∞"):
        assert part in html


def test_a_run_without_a_catalogue_is_refused(tmp_path):
    with pytest.raises(UserError, match=r"give the catalogue\.h5"):
        write_run_page(tmp_path)


def test_a_run_is_not_lost_with_its_page(tmp_path, caplog, monkeypatch):
    paint.report(tmp_path)
    assert "no report.html of this run" in caplog.text
    assert "Traceback" not in caplog.text
    monkeypatch.setattr(paint, "write_run_page", lambda folder: 1 / 0)
    paint.report(tmp_path)
    assert "ZeroDivisionError" in caplog.text


def test_text_from_users_is_escaped():
    config = CONFIG.format(taper=0).replace("astronaut", json.dumps(WRITTEN))
    command = shlex.join(["python", "run.py", f"image={WRITTEN}", "</code><script>alert(1)</script>"])
    html = run_page(replace(saved_with(5), config=config), name="@policy@", command=command)
    assert "<title>@policy@" in html
    assert "<script>alert" not in html
    assert "&lt;script&gt;alert(1)" in html


def test_settings_name_plugins_and_what_was_typed():
    renderer = "{_target_: brushexp.plugins.renderer.analytic.Analytic, soft: 2.0}"
    config = f"steps: 5\nseed: null\nrenderer: {renderer}\n1: {{2: 3}}\n"
    command = "python run.py steps=5 renderer=analytic"
    html = run_page(replace(saved_with(5), config=config), name="x", command=command)
    text = re.sub(r"\s+", " ", re.sub(r"<[^>]*>", " ", html.partition("All settings")[2]))
    assert "steps 5 typed seed null" in text
    assert "renderer typed key value renderer analytic typed renderer.soft 2.0" in text
    assert "1.2 3" in text
    assert command in html


@pytest.mark.parametrize("config", ["{[1]: 2}", "a: !!python/name:os.system x", ""])
def test_a_config_from_elsewhere_that_holds_no_settings_is_left_out(config):
    assert 'id="settings"' not in run_page(replace(saved_with(5), config=config), name="x")


def test_a_damaged_picture_is_left_out(tmp_path, caplog):
    folder = run_in(tmp_path / "run")
    whole = (folder / "painting.png").read_bytes()
    for damaged in (b"nothing", whole[: len(whole) // 2]):
        (folder / "painting.png").write_bytes(damaged)
        html = write_run_page(folder).read_text()
        assert 'id="painting"' not in html
        assert "painting.png is left out" in caplog.text
        caplog.clear()


def test_damaged_curves_are_left_out(tmp_path):
    path = tmp_path / "metrics.csv"
    path.write_bytes(b"step,psnr\n1,20,30\n2\n3,x\n")  # too many, too few, no number
    found = read_curves(path)
    assert found["step"] == [1, 2, 3]
    assert_array_equal(found["psnr"], [20, math.nan, math.nan])
    path.write_bytes(b"step,psnr\n\xff\x00\n")
    assert read_curves(path) is None


def test_a_missing_name_is_an_error():
    with pytest.raises(Exception, match="undefined"):
        page("run.html.j2", name="x")


# ---- pieces ----


def test_packed_strokes_are_the_strokes():
    saved = saved_with(200)
    measures = measure_strokes(saved.strokes, saved.depth, saved.size)
    packed = replay_of(saved, measures)
    data = base64.b64decode(packed["data"])
    assert len(data) == 34 * 200
    found, at = {}, 800
    for name, each, low, high in packed["columns"]:
        shares = np.frombuffer(data, "<u2", 200 * each, at).reshape(200, each) / STEPS
        found[name], at = low + shares * (high - low), at + 400 * each
    order = saved.depth.argsort().numpy()
    assert_array_equal(np.frombuffer(data, "<u4", 200), order)
    assert_allclose(found["points"].reshape(200, 3, 2), curve_of(saved.strokes).numpy()[order], atol=0.01)
    assert_allclose(2 * found["half"][:, 0], measures.width[order], atol=0.001)
    assert_allclose(found["paint"], saved.strokes.color.numpy()[order], atol=1e-4)
    assert_allclose(found["layer"][:, 0].round(3).sum(), 200 - 1, atol=2)  # 0, 1 and 2 are thirds


def test_strokes_far_away_do_not_coarsen_the_others():
    saved = saved_with(20)
    position = saved.strokes.position.clone()
    position[0] = 1e6
    width = saved.strokes.width.clone()
    width[1] = 1e3
    saved = replace(saved, strokes=replace(saved.strokes, position=position, width=width))
    packed = replay_of(saved, measure_strokes(saved.strokes, saved.depth, saved.size))
    highest = {name: high for name, _, _, high in packed["columns"]}
    assert highest["points"] <= (1 + FARTHEST) * max(SIZE)
    assert highest["half"] <= FARTHEST * max(SIZE)


def test_an_error_map_measures_mean_differences():
    target = np.zeros((4, 6, 3), np.uint8)
    painting = target.copy()
    painting[1, 2] = (3, 6, 9)
    found = error_map(painting, target)
    assert found.mean == pytest.approx(6 / 24)
    assert found.top == 8
    assert_array_equal(found.pixels[0, 0], (0, 0, 4))
    assert found.pixels[1, 2].sum() > 300
    assert error_map(target, target).mean == 0


def test_swatches_are_the_colors_and_their_shares():
    colors = np.repeat([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [1.0, 1.0, 1.0]], [10, 20, 30], axis=0)
    found = swatches_of(colors, np.ones(60))
    assert [(swatch.color, round(swatch.share, 3)) for swatch in found] == [
        ("#0000ff", 0.333), ("#ff0000", 0.167), ("#ffffff", 0.5),
    ]  # fmt: skip
    assert swatches_of(colors, np.zeros(60)) == []


def test_charts_need_something_to_show():
    for x, y in (([1], [2]), ([1, 2], [math.nan, 2]), ([1, 2], []), ([3, 3], [1, 2])):
        assert line_chart("x", x, y, "steps") is None
    assert line_chart("x", [1, 2, 3], [3, math.nan, 5], "steps")["y"] == [3, 5]
    assert len(line_chart("x", range(5000), range(5000), "steps")["x"]) == 400
    assert histogram_chart("x", np.array([math.nan]), "px") is None
    assert histogram_chart("x", np.zeros(5), "px")["counts"][0] == 5
    assert sum(histogram_chart("x", np.random.default_rng(1).exponential(5, 1000), "px")["counts"]) == 1000
    assert rose_chart("x", np.array([math.nan]), np.ones(1)) is None
    assert rose_chart("x", np.array([0.0, 3.13, math.pi / 2]), np.ones(3))["shares"][::9] == pytest.approx(
        [2 / 3, 1 / 3]
    )


def test_large_pictures_are_shrunk_and_small_ones_are_kept(tmp_path):
    noise = np.random.default_rng(0).integers(0, 256, (1000, 2000, 3), dtype=np.uint8)
    write_picture(tmp_path / "large.png", noise)
    write_picture(tmp_path / "small.png", noise[:50, :70])
    large, small = picture_uri(tmp_path / "large.png"), picture_uri(tmp_path / "small.png")
    assert large.startswith("data:image/jpeg")
    with Image.open(io.BytesIO(base64.b64decode(large.partition(",")[2]))) as image:
        assert image.size == (LARGEST_SIDE, LARGEST_SIDE // 2)
    assert small == data_uri((tmp_path / "small.png").read_bytes())


# ---- in a browser ----


def test_the_divider_follows_keys_and_pointer(shown):
    wipe = shown.page.locator(".hero .wipe")
    split = "element => getComputedStyle(element).getPropertyValue('--split')"
    before = float(wipe.evaluate(split).rstrip("%"))
    shown.page.locator(".hero .wipe input").focus()
    shown.page.keyboard.press("ArrowRight")
    assert float(wipe.evaluate(split).rstrip("%")) > before
    wipe.scroll_into_view_if_needed()
    box = wipe.bounding_box()
    shown.page.mouse.move(box["x"] + 0.5 * box["width"], box["y"] + 0.5 * box["height"])
    shown.page.mouse.down()
    shown.page.mouse.move(box["x"] + 0.25 * box["width"], box["y"] + 0.6 * box["height"])
    shown.page.mouse.up()
    assert float(wipe.evaluate(split).rstrip("%")) == pytest.approx(25, abs=0.5)


def test_charts_are_drawn_with_ticks_inside(shown):
    drawn = "() => [...document.querySelectorAll('.chart')].map(e => e.querySelectorAll('.line, .bin').length)"
    assert shown.evaluate(drawn) == [1, 1, 1, 28, 28, 28, 28, 28, 36]
    titles = shown.evaluate(
        "() => [...document.querySelectorAll('.chart')[3].querySelectorAll('title')].map(e => e.textContent)"
    )
    assert sum(int(re.search(r": (\d+) strokes", title)[1]) for title in titles) == 300
    assert shown.evaluate("() => document.querySelectorAll('.chart .axis-name')[5].textContent") == "logarithmic"
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
    assert shown.evaluate(ticks) == []


def test_the_scrubber_goes_forwards_and_back_to_the_same_pixels(shown):
    pixels = {}
    for count in (120, 299, 121, 120, 0, 299):
        scrub(shown, count)
        assert_array_equal(seen(shown), pixels.setdefault(count, seen(shown)))
    assert (pixels[120] != pixels[121]).any()
    assert_array_equal(np.unique(pixels[0].reshape(-1, 3), axis=0), [[204, 179, 153]])


@pytest.mark.parametrize("taper", [0.0, 0.8])
def test_the_replay_ends_as_the_painting(taper, opened, tmp_path):  # noqa: F811
    size = (300, 400)
    saved = saved_with(200, size, taper=taper)
    strokes = replace(saved.strokes, scale=4 * saved.strokes.scale)
    strokes = replace(strokes, width=torch.where(torch.arange(200) % 4 == 0, 0.008, strokes.width))  # thin ones fade
    saved = replace(saved, strokes=strokes)
    write_text(tmp_path / "report.html", run_page(saved, name="x"))
    watched = opened(tmp_path / "report.html", (1440, round(300 / 0.64)))  # a pixel of the page is one of the painting
    see(watched, "#replay")
    idle(watched)
    picture = seen(watched)
    assert abs(picture.shape[0] - 300) <= 1
    picture = np.asarray(Image.fromarray(picture).resize((400, 300)))
    assert psnr(picture, painting_of(saved)) > 30
    assert not watched.errors


def test_play_lays_strokes_and_stops_at_the_end(shown):
    scrub(shown, 100)
    shown.page.select_option("#speed", "10")
    shown.page.click("#play")
    assert shown.page.locator("#play").text_content() == "Pause"
    shown.page.wait_for_selector("#replay-stage[data-playing=false][data-shown='300']")
    assert shown.page.locator("#play").text_content() == "Play"
    shown.page.click("#play")  # from the beginning
    shown.page.click("#play")
    assert int(shown.page.locator("#scrubber").input_value()) < 300


def oracle(saved: Saved, points: np.ndarray) -> list[int | None]:
    """The uppermost stroke at each point; None where rounding may decide."""
    curve, half = curve_of(saved.strokes), half_width_of(saved.strokes)
    place = torch.as_tensor(points, dtype=torch.float32)[None].expand(len(half), -1, -1)
    away = (point_at(curve[:, None], closest_parameter(curve[:, None], place)) - place).norm(dim=-1)
    margin = half[:, None] - away  # (N, P)
    found: list[int | None] = []
    for column in margin.T:
        sure, maybe = (column > 0.3).nonzero().ravel(), (column.abs() <= 1.5).nonzero().ravel()
        top = max(sure.tolist(), key=lambda k: int(saved.depth[k]), default=None)
        doubt = top is None or any(saved.depth[k] > saved.depth[top] for k in maybe.tolist() if column[k] <= 0.3)
        found.append(None if doubt else top)
    return found


def test_pointing_tells_the_uppermost_stroke(shown):
    saved = saved_with(300)
    scrub(shown, 300)
    see(shown, "#replay")
    points = np.random.default_rng(2).uniform([2, 2], [SIZE[1] - 2, SIZE[0] - 2], (60, 2))
    wanted = [
        (point, stroke) for point, stroke in zip(points, oracle(saved, points), strict=True) if stroke is not None
    ]
    assert len(wanted) > 15
    measures = measure_strokes(saved.strokes, saved.depth, saved.size)
    for (x, y), stroke in wanted[:15]:
        hover(shown, x, y)
        assert field_of(shown, "number") == str(stroke)
        assert field_of(shown, "depth") == f"{int(saved.depth[stroke]) + 1} of 300"
        assert field_of(shown, "length") == f"{measures.length[stroke]:.1f} px"
        assert field_of(shown, "width") == f"{measures.width[stroke]:.1f} px"
    assert seen(shown, ".replay-over").any()
    shown.page.mouse.move(2, 2)
    assert shown.page.locator("#stroke").get_attribute("data-empty") == "true"
    point, stroke = wanted[0]
    hover(shown, *point)
    shown.page.mouse.down()  # a tap keeps it until Escape
    shown.page.mouse.up()
    shown.page.mouse.move(2, 2)
    assert field_of(shown, "number") == str(stroke)
    assert shown.page.locator("#stroke").get_attribute("data-empty") == "false"
    shown.page.locator("#replay-stage").focus()
    shown.page.keyboard.press("Escape")
    assert shown.page.locator("#stroke").get_attribute("data-empty") == "true"


def test_arrow_keys_step_through_strokes(shown):
    order = saved_with(300).depth.argsort().tolist()
    scrub(shown, 50)
    shown.page.locator("#replay-stage").focus()
    for key, count in (("ArrowRight", 51), ("ArrowLeft", 50), ("Shift+ArrowRight", 150), ("End", 300), ("Home", 0)):
        shown.page.keyboard.press(key)
        shown.page.wait_for_selector(f"#replay-stage[data-shown='{count}'][data-busy=false]")
        if count:
            assert field_of(shown, "number") == str(order[count - 1])
    shown.page.keyboard.press("Space")
    assert shown.page.locator("#replay-stage").get_attribute("data-playing") == "true"
    shown.page.keyboard.press("Space")


def test_layers_can_be_left_out(shown):
    scrub(shown, 300)
    whole = seen(shown)
    boxes = [shown.page.locator(f"[data-layer={layer}]") for layer in ("large", "medium", "small")]
    for box in boxes:
        box.uncheck()
        idle(shown)
        assert (seen(shown) != whole).any()
    assert len(np.unique(seen(shown).reshape(-1, 3), axis=0)) == 1
    for box in boxes:
        box.check()
    idle(shown)
    assert_array_equal(seen(shown), whole)


def test_the_lamp_follows_keys_and_pointer(shown):
    canvas = "#light-stage canvas"
    before = seen(shown, canvas)
    shown.page.locator("#azimuth").focus()
    shown.page.keyboard.press("Home")
    shown.page.wait_for_timeout(100)
    assert (seen(shown, canvas) != before).any()
    assert shown.page.locator("output[for=azimuth]").text_content() == "0°"
    see(shown, "#light")
    box = shown.page.locator("#light-stage").bounding_box()
    shown.page.mouse.move(box["x"] + 0.8 * box["width"], box["y"] + 0.5 * box["height"])
    shown.page.mouse.down()
    shown.page.mouse.up()
    assert float(shown.page.locator("#azimuth").input_value()) == pytest.approx(90, abs=1)


def test_light_is_that_of_the_program(shown, run):
    data = json.loads(shown.page.locator("#heights").text_content())
    with Image.open(io.BytesIO(base64.b64decode(data["source"].partition(",")[2]))) as image:
        levels = np.asarray(image).astype(np.float32)
    height = (256 * levels[..., 0] + levels[..., 1]) / 65535 * data["top"]
    with Image.open(run / "painting.png") as image:
        color = np.asarray(image.convert("RGB")).transpose(2, 0, 1).astype(np.float32) / 255
    light = {"azimuth": 200, "elevation": 35, "depth": 1.5, "gloss": 0.4}
    for name, value in light.items():
        slide(shown, f"#{name}", value)
    shown.page.wait_for_timeout(100)
    wanted = shaded(color, normals_of(height, 1.5), Light(200, 35), 0.4).transpose(1, 2, 0) * 255
    away = np.abs(seen(shown, "#light-stage canvas") - wanted)
    assert away.mean() < 1
    assert away.max() < 6


def test_every_control_has_a_name(shown):
    nameless = """() => [...document.querySelectorAll("button, input, select, [tabindex='0'], img, [role=img]")]
        .filter((e) => !(e.getAttribute("aria-label") || e.labels?.length || e.textContent.trim()))
        .filter((e) => !e.hasAttribute("alt"))
        .map((e) => e.outerHTML.slice(0, 80))"""
    assert shown.evaluate(nameless) == []
    names = shown.evaluate("() => [...document.querySelectorAll('[id]')].map((e) => e.id)")
    assert len(set(names)) == len(names)


def test_it_fits_every_screen_can_be_read_and_printed(run, opened):  # noqa: F811
    watched = opened(run / "report.html", still=True)
    page, paper = watched.page, "getComputedStyle(document.body).backgroundColor"
    watched.evaluate("() => document.querySelectorAll('details').forEach((one) => { one.open = true; })")
    for width, height in (WIDE, NARROW):
        page.set_viewport_size({"width": width, "height": height})
        for scheme in ("light", "dark"):
            page.emulate_media(color_scheme=scheme)
            assert not watched.is_too_wide()
            assert watched.evaluate(TOO_FAINT) == []
    dark = watched.evaluate(paper)
    toggle = page.get_by_role("button", name="Dark colours")
    toggle.click()
    assert watched.evaluate(paper) != dark
    toggle.click()  # dark is chosen now, and not only the system's
    assert (watched.evaluate(paper), toggle.get_attribute("aria-pressed")) == (dark, "true")
    page.click("[data-copy]")
    page.wait_for_selector("[data-copy]:has-text('Copied')")
    page.emulate_media(media="print")
    levels = "['color', 'backgroundColor'].map(k => getComputedStyle(document.body)[k].match(/[0-9]+/g).slice(0, 3))"
    ink, ground = watched.evaluate(levels)
    assert max(map(int, ink)) < 80
    assert min(map(int, ground)) > 240
    assert not page.locator("#play").is_visible()
    assert not watched.errors
    assert not watched.foreign


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


@pytest.mark.parametrize("size", [(400, 4), (1, 90)])
def test_long_and_narrow_pictures_fit_into_the_window(size, opened, tmp_path):  # noqa: F811
    saved = saved_with(20, size)
    painting = painting_of(saved)
    write_text(tmp_path / "a.html", run_page(saved, name="narrow", pictures={"target": painting, "painting": painting}))
    watched = opened(tmp_path / "a.html")
    assert not watched.is_too_wide()
    tallest = watched.evaluate("Math.max(...[...document.querySelectorAll('.stage')].map(e => e.clientHeight))")
    assert tallest <= WIDE[1]
    assert not watched.errors


def test_without_scripts_what_needs_them_is_left_out(run, browser):  # noqa: F811
    context = browser.new_context(java_script_enabled=False)
    page = context.new_page()
    page.goto((run / "report.html").resolve().as_uri())
    assert page.locator("noscript p").is_visible()
    for gone in ("#replay", "#light", "[data-copy]", "img[data-of]", ".nav [href='#replay']"):
        assert not page.locator(gone).first.is_visible(), gone
    box = page.locator("#error-picture").bounding_box()
    assert box["width"] / box["height"] == pytest.approx(SIZE[1] / SIZE[0], rel=0.02)
    context.close()


def test_the_policy_runs_no_scripts_in_names_and_nothing_that_is_not_in_the_page(opened, tmp_path):  # noqa: F811
    folder = run_in(tmp_path / "x", image=WRITTEN, overrides=(f"image={WRITTEN}", "steps=<b onclick=alert(1)>"))
    watched = opened(write_run_page(folder))
    assert watched.page.locator("h1").text_content() == "script>\"'&amp;.png"  # the file's name, after the last slash
    assert "<b onclick=alert(1)>" in watched.page.locator(".command code").text_content()
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


def test_ten_thousand_strokes_make_a_small_page_and_are_replayed(opened, tmp_path):  # noqa: F811
    path = tmp_path / "report.html"
    write_text(path, run_page(saved_with(10_000, (800, 1000)), name="many"))
    assert path.stat().st_size < 1_000_000
    watched = opened(path)
    see(watched, "#replay")
    idle(watched)
    watched.page.select_option("#speed", "10")
    watched.page.click("#play")
    watched.page.wait_for_selector("#replay-stage[data-playing=false][data-shown='10000']")
    last = seen(watched)
    scrub(watched, 4_321)  # from a key frame
    scrub(watched, 10_000)
    assert_array_equal(seen(watched), last)
    assert not watched.errors
