"""Test that extreme scenes break neither renderers nor strokes; this is the fast part of ``experiment=extremes``."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import torch
from brushexp_thesis.extremes import check, task
from brushexp_thesis.extremes.check import BROKEN, DEGRADED, DTYPES, EXACT, REFUSED, Drawn, SceneCheck
from brushexp_thesis.extremes.scenes import KINDS, MANY_STEPS, SMALL, Scene, random_strokes
from brushexp_thesis.extremes.scenes import ONE_PICTURE as SCENES
from brushexp_thesis.extremes.task import cells_in, choose_axes, frozen_renderer, number_of
from refusals import refuses
from sweeps import read_csv

from brushexp.plugins.blend.dense import Dense
from brushexp.plugins.renderer.analytic import Analytic
from brushexp.plugins.renderer.base import LEAST_ALPHA, Renderer
from brushexp.registry import build_named, plugins
from brushexp.strokes.catalogue import FARTHEST_POSITION, Catalogue, check_strokes, drawable

# Scenes that only the study has time for, including kernels for seven channels.
SLOW_SCENES = ("10,000 on one pixel", "canvas 8192 x 8", "pure colours in pigment", "mixing in pigment")
BLENDS = {plugin.name: build_named("blend", plugin.name, {}) for plugin in plugins("blend")}
CELLS = [("tiled", dtype) for dtype in DTYPES] + [(name, "float32") for name in BLENDS if name != "tiled"]
BOUNDS = check.PICTURE_BOUNDS["float32"], check.GRADIENT_BOUNDS["float32"]
# Known exceptions: maximum difference of float32 from float64 for a pixel, and relative difference for a gradient.
DEGRADED_BY = {
    "windows 1e6 px away": (0.03, 0.3),  # float32 has steps of 1/16 px there
    "length 10,000 px": (1e-4, 0.01),  # textured; texels are a thousand times longer than wide
    "width 0": (1e-4, 1.0),  # topk; rounding decides which strokes are empty, and empty strokes have no gradient
}
frozen = cache(frozen_renderer)  # built once, and not when this file is imported
no_eval_warning = pytest.mark.filterwarnings("ignore:.*in eval mode at the start of training")


def renderers(formulas: bool) -> dict[str, Renderer]:
    """Return all renderers that are formulas, or all that are networks."""
    made = {plugin.name: frozen(plugin.name) for plugin in plugins("renderer")}
    return {name: renderer for name, renderer in made.items() if (renderer.warm_up is None) == formulas}


@pytest.mark.parametrize("name", SCENES)
def test_no_scene_breaks_a_formula_and_all_have_strokes_in_range(name):
    scene = SCENES[name]
    for most in (1, 24):
        check_strokes(scene.strokes(most))
        assert len(scene.strokes(most)) == min(scene.n, most)
    assert scene.target(scene.canvas).shape == (3, *scene.canvas)
    formulas = renderers(formulas=True).values()
    turn = [*SCENES].index(name) % len(formulas)  # each scene combines the other blends with a different renderer
    for k, renderer in enumerate(() if name in SLOW_SCENES else formulas):
        checks = SceneCheck(renderer, scene, 6)
        for blend, dtype in CELLS if k == turn else CELLS[: len(DTYPES)]:
            result = checks.check(BLENDS[blend], dtype)
            place = f"{renderer} {blend} {dtype}: {result}"
            assert result.verdict != BROKEN, place
            if dtype == "float32":
                assert np.less_equal((result.picture, result.gradient), DEGRADED_BY.get(name, BOUNDS)).all(), place
            if (blend, dtype) == ("tiled", "float64"):
                assert result.verdict == EXACT, place


@pytest.mark.parametrize("scene", ["no strokes", "length 0", "length 10,000 px", "width 0", "1e6 px off the canvas"])
def test_no_scene_breaks_a_network(scene):
    for name, renderer in renderers(formulas=False).items():
        checks = SceneCheck(renderer, SCENES[scene], 2)
        for dtype in ("float32", "float16"):
            result = checks.check(BLENDS["tiled"], dtype)
            assert result.verdict != BROKEN, f"{name} {dtype}: {result}"
            assert result.picture is None or result.picture <= LEAST_ALPHA, f"{name} {dtype}: {result}"


@pytest.mark.parametrize("exercise", [name for name in MANY_STEPS if name not in SLOW_SCENES])
@no_eval_warning
def test_no_target_and_no_rate_spoils_the_strokes(exercise):
    short = replace(MANY_STEPS[exercise], steps=min(MANY_STEPS[exercise].steps, 16))
    for name, renderer in renderers(formulas=True).items():
        result = check.check_painting(name, renderer, short, 60.0, BLENDS["tiled"], "float32")
        assert result.verdict == EXACT, f"{name}: {result}"


@pytest.mark.parametrize("dtype", ["bfloat16", "float16"])
def test_strokes_of_16_bits_are_drawn_in_float32_and_not_optimised(dtype):
    strokes = random_strokes(4, SMALL).map(lambda value: value.to(DTYPES[dtype]).requires_grad_())
    image = Dense()(Analytic()(strokes), torch.arange(4), SMALL, torch.zeros(3, dtype=DTYPES[dtype])).image
    image.sum().backward()
    assert image.dtype == torch.float32
    assert strokes.position.grad.dtype == DTYPES[dtype]
    scene = replace(MANY_STEPS["1,000 steps"], steps=2)
    result = check.check_painting("analytic", Analytic(), scene, 60.0, BLENDS["tiled"], dtype)
    assert result.verdict == REFUSED
    assert "value.float()" in result.note


def test_strokes_that_a_precision_cannot_hold_are_refused_and_a_number_says_what_is_out_of_bounds():
    far = SCENES["1e6 px off the canvas"].strokes(4)
    assert drawable(far.map(lambda value: value.half())).position.abs().max() == FARTHEST_POSITION
    words = r"scale is .*inf.*make them in float32"
    refuses(words, drawable, replace(far, scale=far.scale * 1e5).map(lambda value: value.half()))
    refuses("int64; convert them", drawable, far.map(lambda value: value.long()))
    assert drawable(far) is far
    refuses("small steps are lost", Catalogue, random_strokes(2, SMALL).map(lambda value: value.bfloat16()), {})
    cell = {"verdict": EXACT, "dtype": "float32", "picture": 2e-5, "gradient": 0.5}
    assert number_of(cell) == "2e-5"
    assert number_of(cell | {"verdict": DEGRADED}) == "g 5e-1"
    assert number_of(cell | {"picture": None}) == ""


def test_verdicts_are_what_they_say():
    picture, slope = torch.rand(3, 4, 5, dtype=torch.float64), torch.tensor([1.0, -2.0], dtype=torch.float64)
    exact, strokes = Drawn(picture, {"opacity": slope}, 1.0), random_strokes(2, SMALL)
    for verdict, image, gradient, fault in (
        (EXACT, picture.float(), slope.float(), ""),
        (DEGRADED, picture + 2 * BOUNDS[0], slope, ""),
        (DEGRADED, picture, slope * (1 + 2 * BOUNDS[1]), ""),
        (BROKEN, picture * torch.nan, slope, ""),
        (BROKEN, picture + 1, slope, ""),
        (BROKEN, picture, slope * torch.inf, ""),
        (BROKEN, picture, slope, "alpha is not finite"),
    ):
        drawn = Drawn(image, {"opacity": gradient}, 1.0, fault)
        assert check.compare("float32", drawn, exact, strokes).verdict == verdict
    assert check.range_fault(strokes) == ""
    assert check.range_fault(replace(strokes, color=strokes.color * torch.nan)) == "color is not finite"
    assert "opacity goes from" in check.range_fault(replace(strokes, opacity=strokes.opacity + 1))


def test_a_crash_is_a_bug_and_a_message_is_none():
    class Crashing(Analytic):
        def forward(self, strokes):
            raise RuntimeError("expected scalar type Float\nbut found Half")

    result = SceneCheck(Crashing(), SCENES["one stroke"], 1).check(BLENDS["tiled"], "float32")
    assert result == check.Check(BROKEN, note="RuntimeError: expected scalar type Float")
    for scene in ("1e6 px off the canvas", "windows 1e6 px away"):  # farther than float16 can represent
        result = SceneCheck(Analytic(), SCENES[scene], 2).check(BLENDS["tiled"], "float16")
        assert result.verdict in (EXACT, DEGRADED)
        assert result.picture < 1e-4


@no_eval_warning
def test_the_task_writes_every_cell_and_ends_with_an_error_if_one_is_broken(run_task, tmp_path, monkeypatch):
    axes = choose_axes(dtypes=None)
    assert axes["renderers"] == [plugin.name for plugin in plugins("renderer")]
    assert cells_in(axes) == len(axes["renderers"]) * len(BLENDS) * len(DTYPES) * (len(SCENES) + len(MANY_STEPS))
    words = ("task=extremes", "renderers=[analytic]", "dtypes=[float32,float16]", "patience=0.01")
    refuses(r"blends has no 'tilde'.*tiled", run_task, task, *words, "blends=[tilde]")
    result = run_task(task, *words, "blends=[tiled]", 'scenes=["1e6 px off the canvas","target 0"]')
    rows = read_csv(tmp_path / "extremes.csv")
    assert len(rows) == 6
    assert {row["kind"] for row in rows} == {*KINDS}
    assert any(row["note"].endswith("of 30 steps") for row in rows)
    assert [result[f"n_{verdict}"] for verdict in check.VERDICTS] == [5, 0, 1, 0]
    assert (tmp_path / "extremes.png").stat().st_size > 5000
    monkeypatch.setitem(SCENES, "target 0", Scene(lambda strokes: {"color": 9 * strokes.color}))
    message = r"1 of 2 cells are broken, the first is target 0 \(one picture, renderer="
    refuses(message, run_task, task, *words, "blends=[tiled]", "scenes=[target 0]", "dtypes=[float32]")
