"""Tests of relief: the heights of the paint, and how a lamp lights them."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from catalogues import catalogue, job_of
from dabs import DabRenderer
from PIL import Image
from refusals import refuses
from scenes import Windowed, random_strokes, straight

from brushexp.compositing import bands as banding
from brushexp.painting.reopen import export_job, light_of
from brushexp.plugins.blend.tiled import Tiled
from brushexp.plugins.renderer.analytic import Analytic
from brushexp.plugins.renderer.textured import Textured
from brushexp.registry import build_named, plugins
from brushexp.shading.height import CARRIED, FILM, Impasto, surface_height, typical_width
from brushexp.shading.light import Light, normals_of, shade_picture
from brushexp.strokes.bezier import half_width_of
from brushexp.strokes.catalogue import Strokes
from brushexp.strokes.storage import load_catalogue
from brushexp.tasks import export, paint

WHITE, BLACK = (1.0, 1.0, 1.0), (0.0, 0.0, 0.0)
RENDERERS = {"plain": Analytic(), "pointed": Analytic(taper=1.0), "bristles": Textured(checkpoint=None)}
RENDERERS |= {"windows": Windowed(), "another kind": DabRenderer()}


def painted(strokes, size, *, renderer=RENDERERS["plain"], depth=None):
    return job_of(strokes, size, renderer=renderer, blend=Tiled(opaque=0.0), depth=depth)


def thick(n, size, **options):
    """Make random strokes that are wide enough for visible bristles."""
    strokes = random_strokes(n, size, width=(0.2, 0.5), **options)
    return replace(strokes, opacity=0.3 + 0.7 * strokes.opacity)


@pytest.mark.parametrize("name", RENDERERS)
def test_heights_are_those_of_strokes_laid_one_after_another_and_of_no_paint_where_there_is_none(name):
    size, strokes = (26, 39), thick(25, (26, 39))
    depth = torch.randperm(25).int()
    job = painted(strokes, size, renderer=RENDERERS[name], depth=depth)
    with torch.no_grad():  # textures as in painting
        layers = Impasto(RENDERERS[name], typical_width(strokes))(strokes)
    y, x = torch.meshgrid(torch.arange(size[0]), torch.arange(size[1]), indexing="ij")
    points = torch.stack([x, y], dim=-1).reshape(1, -1, 2) + 0.5
    height = torch.zeros(size)
    with torch.no_grad():
        for stroke in depth.argsort():
            alpha, color = layers.sample(stroke.reshape(1, 1), points)
            a = (alpha / CARRIED).reshape(size)  # of the stroke itself
            t = (color[..., 0] * CARRIED).expand(1, 1, -1).reshape(size)
            height = height * (1 - CARRIED * a) + a * t
    computed = job.height()
    assert computed.dtype == np.float32
    assert computed.max() > 0
    np.testing.assert_allclose(computed, height.numpy(), atol=2e-4)
    strokes = Strokes.join(straight((2, 3), (14, 9), opacity=0.0), straight((2, 9), (14, 3), width=0.0))
    strokes = strokes[:1] if name == "windows" else strokes  # a network has a least width of strokes
    assert (painted(strokes, (12, 17), renderer=RENDERERS[name]).height() == 0).all()


@pytest.mark.parametrize("name", [plugin.name for plugin in plugins("renderer")])
def test_every_renderer_has_heights_between_the_canvas_and_the_thickest_paint(name):
    renderer = build_named("renderer", name, {})
    strokes = renderer.clamp(thick(6, (20, 30)))
    with torch.no_grad():
        height = painted(strokes, (20, 30), renderer=renderer).height()
    assert np.isfinite(height).all()
    assert height.min() >= 0
    thickest = 2 * float(half_width_of(strokes).max())
    assert height.max() <= FILM * math.sqrt(thickest * typical_width(strokes)) / CARRIED + 1e-4


def test_there_is_paint_where_the_stroke_is_pushed_aside_to_either_side_and_nowhere_else():
    height = painted(straight((20, 15), (60, 15), width=12, color=WHITE), (30, 80)).height()
    y, x = np.mgrid[:30, :80] + 0.5
    distance = np.hypot(y - 15, np.maximum(0, np.maximum(20 - x, x - 60)))
    assert (height[distance < 0.6 * 6] > 0.05 * FILM * 12).all()
    assert (height[distance > 1.2 * 6 + 1] == 0).all()
    stroke, clear = (straight((20, 15), (60, 15), width=12, color=WHITE, opacity=opacity) for opacity in (1.0, 0.0))
    brushes = [Strokes.join(*[clear] * number, stroke) for number in range(8)]
    mean = np.mean([painted(strokes, (30, 80)).height()[:, 25:55].mean(1) for strokes in brushes], axis=0)
    middle, sides = mean[13:17].mean(), (mean[9:12].mean(), mean[18:21].mean())
    assert np.mean(sides) > 1.1 * middle
    assert sides[0] == pytest.approx(sides[1], rel=0.25)
    np.testing.assert_array_less(mean[:9], max(sides))


def test_dark_paint_is_thin_and_paint_of_one_lightness_equally_thick():
    thickness = {}
    for name, color in {"white": WHITE, "black": BLACK, "red": (1.0, 0.0, 0.0), "grey": (0.299, 0.299, 0.299)}.items():
        thickness[name] = painted(straight((20, 15), (60, 15), width=12, color=color), (30, 80)).height().max()
    assert 0 < thickness["black"] < 0.2 * thickness["white"]
    assert thickness["black"] < thickness["red"] < thickness["white"]
    assert thickness["grey"] == pytest.approx(thickness["red"], rel=1e-5)


def test_furrows_are_as_deep_as_they_are_seen_in_the_colour():
    strokes = straight((20, 15), (60, 15), width=12, color=WHITE)
    rough, smooth = (
        painted(strokes, (30, 80), renderer=Textured(checkpoint=None, tone=tone)).height()[12:18, 30:50]
        for tone in (1.0, 0.0)
    )
    assert smooth[:, 5:15].std(1).mean() < 0.5 * rough[:, 5:15].std(1).mean()


def test_thick_paint_hides_the_threads_of_a_canvas():
    threads = hills(8, 8, roughness=0.1)
    np.testing.assert_array_equal(surface_height(np.zeros((8, 8), np.float32), threads, 10), threads)
    film = np.full((8, 8), FILM * 10, np.float32)
    assert np.ptp(surface_height(film, threads, 10)) < 0.05 * np.ptp(threads)


@pytest.mark.parametrize("name", ["plain", "pointed", "bristles"])
def test_where_bristles_are_large_enough_to_be_seen_slopes_do_not_depend_on_the_size(name):
    strokes = straight((30, 50), (70, 55), width=60, color=WHITE)
    slopes = []
    for zoom in (8, 16):
        size = (100 * zoom, 120 * zoom)
        height = painted(strokes.moved(zoom=zoom), size, renderer=RENDERERS[name]).height()
        slopes.append(np.hypot(*np.gradient(height)).mean())
    assert slopes[0] > 0.01
    assert slopes[1] == pytest.approx(slopes[0], rel=0.1)


def hills(height, width, *, roughness=1.0):
    return (roughness * np.random.default_rng(0).random((height, width))).astype(np.float32)


def lit_grey(value, height, azimuth, elevation, gloss=0.0):
    """Shade a grey canvas with the given heights (H, W) under a light, and return its grey values."""
    color = np.full((3, *height.shape), value, np.float32)
    return shade_picture(color, normals_of(height), Light(azimuth, elevation, gloss=gloss))[0]


def test_a_flat_canvas_keeps_its_colours_and_slopes_shine_that_face_the_lamp():
    color, normals = np.random.default_rng(0).random((3, 7, 11)), normals_of(np.full((7, 11), 3.0, np.float32))
    for light in (Light(315, 45), Light(0, 90), Light(123.4, 0.5), Light(-700, 17)):
        for gloss in (0.0, 1.0):
            np.testing.assert_allclose(
                shade_picture(color.astype(np.float32), normals, replace(light, gloss=gloss)), color, atol=1e-6
            )
    ridge = np.tile(np.float32([0, 0, 1, 2, 2, 1, 0, 0]), (5, 1))  # faces left in columns 1 to 3
    lit = lit_grey(0.5, ridge, 270, 30)[2]
    assert lit[2] > 0.5 > lit[5]
    np.testing.assert_allclose(lit[[0, 7]], 0.5, atol=1e-6)
    np.testing.assert_allclose(lit_grey(0.5, ridge.T, 0, 30)[:, 2], lit, atol=1e-6)  # from the top
    slope = math.tan(math.radians(22.5)) * np.tile(np.arange(5, dtype=np.float32), (3, 1))  # faces left, halfway
    matt, wet = (lit_grey(0.2, slope, 270, 45, gloss)[1, 2] for gloss in (0.0, 1.0))
    assert wet > matt + 0.3
    assert lit_grey(0.2, slope, 90, 45, 1.0)[1, 2] < 0.2


@pytest.mark.parametrize(
    ("azimuth", "right", "up"), [(0, 0, 1), (90, 1, 0), (180, 0, -1), (315, -(0.5**0.5), 0.5**0.5)]
)
def test_directions_are_clockwise_from_the_top(azimuth, right, up):
    np.testing.assert_allclose(Light(azimuth, 45).direction, np.array([right, up, 1]) * math.sqrt(0.5), atol=1e-6)


def test_normals_are_those_of_the_plane_have_unit_length_and_can_be_had_row_by_row():
    y, x = np.mgrid[:6, :9].astype(np.float32)
    normal = normals_of(0.3 * x - 0.2 * y, 2.0)[:, 3, 4]  # rises to the right and, as rows go down, upwards
    np.testing.assert_allclose(normal, np.array([-0.6, -0.4, 1]) / math.sqrt(1 + 0.36 + 0.16), atol=1e-5)
    height = hills(10, 7, roughness=5)
    whole = normals_of(height, 3.0)
    np.testing.assert_allclose((whole**2).sum(0), 1, atol=1e-5)
    assert (whole[2] > 0).all()
    for rows in (slice(0, 4), slice(3, 9), slice(9, 10), slice(4, 99)):
        np.testing.assert_array_equal(normals_of(height, 3.0, rows), whole[:, rows])


@pytest.mark.parametrize("elevation", [1, 20, 90])
def test_no_light_leaves_the_range_of_colours(elevation):
    color = np.random.default_rng(1).random((3, 20, 30)).astype(np.float32)
    color[:, :5] = np.float32([0, 0.5, 1])[:, None, None]
    lit = shade_picture(color, normals_of(hills(20, 30, roughness=20)), Light(45, elevation, gloss=1.0))
    assert 0 <= lit.min() <= lit.max() <= 1  # fails for nan


@pytest.mark.parametrize("name", RENDERERS)
def test_the_picture_under_a_lamp_is_the_flat_one_shaded_by_the_slopes_of_its_paint(name, monkeypatch):
    lamp = Light(30, 25, depth=1.5, gloss=0.6)
    job = replace(painted(thick(25, (70, 31)), (70, 31), renderer=RENDERERS[name]), light=lamp)
    flat = next(replace(job, light=Light()).bands())[1].numpy()
    expected = shade_picture(flat, normals_of(job.height(), 1.5), lamp)
    assert np.abs(expected - flat).max() > 0.05
    monkeypatch.setattr(banding, "BAND", 31 * 9)
    tops, bands = zip(*job.bands(), strict=True)
    assert len(tops) > 3
    np.testing.assert_allclose(np.concatenate(bands, axis=1), expected, atol=2e-3)


def test_a_lit_painting_is_its_flat_one_under_the_lamp_and_every_export_shows_the_same(run_task, tmp_path):
    small = ["image=chelsea", "resolution=48", "steps=5", "threads=1", "frames=3", "timelapse=gif"]
    metrics = run_task(paint, *small, "light=200,30", "light.depth=2")
    picture = {path.stem: np.asarray(Image.open(path)).astype(float) for path in tmp_path.glob("*.png")}
    for key, name in (("psnr", "flat"), ("psnr_lit", "painting")):
        error = np.square(picture[name] - picture["target"]).mean()
        assert metrics[key] == pytest.approx(10 * math.log10(255**2 / error), abs=1e-3), key
    saved = load_catalogue(tmp_path / "catalogue.h5")
    job = export_job(saved)
    assert job.light == Light(200, 30, depth=2.0)
    color = (picture["flat"] / 255).transpose(2, 0, 1).astype(np.float32)
    lit = 255 * shade_picture(color, normals_of(job.height(), 2.0), job.light).transpose(1, 2, 0)
    assert np.abs(lit - picture["painting"]).max() <= 1.5
    assert np.abs(picture["flat"] - picture["painting"]).max() > 8
    words = ["task=export", f"catalogue={tmp_path / 'catalogue.h5'}", "threads=1"]
    run_task(export, *words, "to=png,relief")
    for name in ("painting", "relief"):
        np.testing.assert_array_equal(np.asarray(Image.open(tmp_path / f"{name}.png")), picture["painting"])
    run_task(export, *words, "light.depth=0")
    np.testing.assert_allclose(np.asarray(Image.open(tmp_path / "painting.png")), picture["flat"], atol=1)


@pytest.mark.parametrize("light", ["{depth: bright}", "{gloss: 7}", "{elevation: 0}", "{depth: .nan}", "7", "depth"])
def test_a_lamp_that_is_none_in_a_catalogue_is_refused(light):
    saved = replace(catalogue(3), config=f"light: {light}")
    refuses(r"light(\.\w+| is)", light_of, saved)
