"""No scene, however absurd, is painted wrongly in silence: the quick part of ``experiment=extremes``."""

from dataclasses import replace
from functools import cache

import pytest
import torch
from brushexp_extremes import check
from brushexp_extremes.check import (
    DTYPES,
    EXERCISES,
    Check,
    DrawnScene,
    Outcome,
    Reference,
    check_drawing,
    check_painting,
)
from brushexp_extremes.matrix import (
    MANY_STEPS,
    ONE_PICTURE,
    MatrixCell,
    cells_in,
    chosen_axes,
    examine,
    frozen_renderer,
)
from brushexp_extremes.report import draw_matrix, matrix_csv, matrix_text, outcome_counts
from brushexp_extremes.scenes import SCENES, random_strokes, random_target

from brushexp.errors import UserError
from brushexp.plugins.blend.dense import Dense
from brushexp.plugins.renderer.analytic import Analytic
from brushexp.plugins.renderer.base import LEAST_ALPHA, Renderer
from brushexp.registry import build_named, plugins
from brushexp.strokes.catalogue import FARTHEST, Catalogue, check_strokes, drawable

# The study alone has the time for them, and for the kernels of seven channels.
SLOW_SCENES = ("10,000 on one pixel", "canvas 8192 x 8", "pure colours in pigment", "mixing in pigment")
BLENDS = {plugin.name: build_named("blend", plugin.name, {}) for plugin in plugins("blend")}
CELLS = [("tiled", dtype) for dtype in DTYPES] + [(name, "float32") for name in BLENDS if name != "tiled"]
BOUNDS = check.PICTURE_BOUNDS["float32"], check.GRADIENT_BOUNDS["float32"]
# By how much float32 may differ from float64 all the same: a pixel, and a gradient against its size.
DEGRADED = {
    "windows 1e6 px away": (0.03, 0.3),  # float32 has steps of 1/16 px there
    "length 10,000 px": (1e-4, 0.01),  # textured: texels are a thousand times longer than wide
    "width 0": (1e-4, 1.0),  # topk: rounding decides which strokes are empty, and those have no gradient
}
frozen = cache(frozen_renderer)  # once, and not when this file is imported
no_eval_warning = pytest.mark.filterwarnings("ignore:.*in eval mode at the start of training")


def renderers(formulas: bool) -> dict[str, Renderer]:
    """Those that are formulas, or those that are networks."""
    made = {plugin.name: frozen(plugin.name) for plugin in plugins("renderer")}
    return {name: renderer for name, renderer in made.items() if (renderer.warm_up is None) == formulas}


@pytest.mark.parametrize("scene", [name for name in SCENES if name not in SLOW_SCENES])
def test_no_scene_breaks_a_formula(scene):
    drawn = SCENES[scene].scene(6)
    for name, renderer in renderers(formulas=True).items():
        reference = Reference(renderer, drawn)
        for blend, dtype in CELLS:
            found = check_drawing(renderer, reference, BLENDS[blend], dtype)
            where = f"{name} {blend} {dtype}: {found}"
            assert found.outcome is not Outcome.broken, where
            if dtype == "float32":
                picture, gradient = DEGRADED.get(scene, BOUNDS)
                assert found.picture <= picture, where
                assert found.gradient <= gradient, where
            if (blend, dtype) == ("tiled", "float64"):
                assert found.outcome is Outcome.exact, where


@pytest.mark.parametrize("scene", ["no strokes", "length 0", "length 10,000 px", "width 0", "1e6 px off the canvas"])
def test_no_scene_breaks_a_network(scene):
    for name, renderer in renderers(formulas=False).items():
        reference = Reference(renderer, SCENES[scene].scene(2))
        for dtype in ("float32", "float16"):
            found = check_drawing(renderer, reference, BLENDS["tiled"], dtype)
            assert found.outcome is not Outcome.broken, f"{name} {dtype}: {found}"
            assert found.picture is None or found.picture <= LEAST_ALPHA, f"{name} {dtype}: {found}"


@pytest.mark.parametrize("exercise", [name for name in EXERCISES if name not in SLOW_SCENES])
@no_eval_warning
def test_no_target_and_no_rate_spoils_the_strokes(exercise):
    short = replace(EXERCISES[exercise], steps=min(EXERCISES[exercise].steps, 40))
    for name, renderer in renderers(formulas=True).items():
        found = check_painting(name, renderer, short, 60.0, BLENDS["tiled"], "float32")
        assert found.outcome is Outcome.exact, f"{name}: {found}"


@pytest.mark.parametrize("dtype", ["bfloat16", "float16"])
def test_strokes_of_16_bits_are_drawn_in_float32_and_not_optimised(dtype):
    strokes = random_strokes(4, check.CANVAS).map(lambda value: value.to(DTYPES[dtype]).requires_grad_())
    image = Dense()(Analytic()(strokes), torch.arange(4), check.CANVAS, torch.zeros(3, dtype=DTYPES[dtype])).image
    image.sum().backward()
    assert image.dtype == torch.float32
    assert strokes.position.grad.dtype == DTYPES[dtype]
    found = check_painting(
        "analytic", Analytic(), check.Exercise(random_target(check.CANVAS), 2), 60.0, BLENDS["tiled"], dtype
    )
    assert found.outcome is Outcome.refused
    assert "value.float()" in found.note


def test_strokes_that_a_precision_cannot_hold_are_refused():
    far = SCENES["1e6 px off the canvas"].scene(4).strokes
    assert drawable(far.map(lambda value: value.half())).position.abs().max() == FARTHEST
    with pytest.raises(UserError, match=r"scale is .*inf.*make them in float32"):
        drawable(replace(far, scale=far.scale * 1e5).map(lambda value: value.half()))
    with pytest.raises(UserError, match="int64; convert them"):
        drawable(far.map(lambda value: value.long()))
    assert drawable(far) is far
    with pytest.raises(UserError, match="small steps are lost"):
        Catalogue(random_strokes(2, check.CANVAS).map(lambda value: value.bfloat16()), {})


@pytest.mark.parametrize("scene", SCENES)
def test_every_scene_has_strokes_in_range(scene):
    for most in (1, 24):
        drawn = SCENES[scene].scene(most)
        check_strokes(drawn.strokes)
        assert len(drawn.strokes) == min(drawn.wanted, most)
        assert drawn.target.shape == (3, *drawn.size)


def test_outcomes_are_what_they_say():
    picture, slope = torch.rand(3, 4, 5, dtype=torch.float64), torch.tensor([1.0, -2.0], dtype=torch.float64)
    exact = DrawnScene(picture, {"opacity": slope}, 1.0)
    cases = {
        Outcome.exact: [(picture.float(), slope.float(), "")],
        Outcome.degraded: [(picture + 2 * BOUNDS[0], slope, ""), (picture, slope * (1 + 2 * BOUNDS[1]), "")],
        Outcome.broken: [
            (picture * torch.nan, slope, ""), (picture + 1, slope, ""), (picture, slope * torch.inf, ""),
            (picture, slope, "alpha is not finite"),
        ],
    }  # fmt: skip
    for outcome, drawn in cases.items():
        for image, gradient, fault in drawn:
            given = DrawnScene(image, {"opacity": gradient}, 1.0, fault)
            assert check.compare("float32", given, exact, random_strokes(2, check.CANVAS)).outcome is outcome
    strokes = random_strokes(2, check.CANVAS)
    assert check.range_fault(strokes) == ""
    assert check.range_fault(replace(strokes, color=strokes.color * torch.nan)) == "color is not finite"
    assert "opacity goes from" in check.range_fault(replace(strokes, opacity=strokes.opacity + 1))


def test_a_crash_is_a_bug_and_a_message_is_none():
    class Crashing(Analytic):
        def forward(self, strokes):
            raise RuntimeError("expected scalar type Float\nbut found Half")

    reference = Reference(Analytic(), SCENES["one stroke"].scene(1))
    found = check_drawing(Crashing(), reference, BLENDS["tiled"], "float32")
    assert found == Check(Outcome.broken, note="RuntimeError: expected scalar type Float")
    for scene in ("1e6 px off the canvas", "windows 1e6 px away"):  # farther than float16 can tell
        far = Reference(Analytic(), SCENES[scene].scene(2))
        found = check_drawing(Analytic(), far, BLENDS["tiled"], "float16")
        assert found.outcome in (Outcome.exact, Outcome.degraded)
        assert found.picture < 1e-4


def test_the_matrix_goes_through_all_that_is_registered():
    axes = chosen_axes(dtypes=None)
    assert axes["renderers"] == [plugin.name for plugin in plugins("renderer")]
    assert axes["blends"] == list(BLENDS)
    drawn = len(axes["renderers"]) * len(BLENDS) * len(DTYPES)
    assert cells_in(axes) == drawn * (len(SCENES) + len(EXERCISES))
    with pytest.raises(UserError, match=r"blends has no 'tilde'.*tiled"):
        chosen_axes(blends=["tilde"])


@no_eval_warning
def test_the_report_has_every_cell_and_every_message(tmp_path):
    scenes = ["1e6 px off the canvas", "target 0"]
    axes = chosen_axes(renderers=["analytic"], blends=["tiled"], dtypes=["float32", "float16"], scenes=scenes)
    cells = list(examine(axes, 0.01))
    assert len(cells) == cells_in(axes) == 6
    assert {cell.kind for cell in cells} == {ONE_PICTURE, MANY_STEPS}
    assert any(cell.check.note.endswith("of 30 steps") for cell in cells)
    place = (ONE_PICTURE, "target 0", "analytic", "mine")
    cells.append(MatrixCell(*place, "float32", Check(Outcome.broken, note="alpha is 2")))
    cells.append(MatrixCell(*place, "float16", Check(Outcome.degraded, 0.0, 0.02)))
    assert outcome_counts(cells) == {"n_exact": 5, "n_degraded": 1, "n_refused": 1, "n_broken": 1}
    assert len(matrix_csv(cells).splitlines()) == len(cells) + 1
    text = matrix_text(cells)
    for words in ("| scene | tiled float32 |", "broken [", "alpha is 2", "optimise them as", "degraded *g* 2e-2"):
        assert words in text
    draw_matrix(cells, tmp_path / "extremes.png")
    assert (tmp_path / "extremes.png").stat().st_size > 5000
