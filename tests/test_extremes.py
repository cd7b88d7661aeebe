"""No scene, however absurd, is painted wrongly in silence: the quick part of ``experiment=extremes``."""

from dataclasses import replace

import pytest
import torch

from brushexp.errors import UserError
from brushexp.plugins.blend.dense import Dense
from brushexp.plugins.renderer.analytic import Analytic
from brushexp.plugins.renderer.base import FAINT
from brushexp.registry import build_named, plugins
from brushexp.stress.check import (
    DTYPES,
    GRADIENT_BOUNDS,
    PICTURE_BOUNDS,
    Check,
    DrawnScene,
    Outcome,
    compare,
    range_fault,
)
from brushexp.stress.matrix import MANY_STEPS, ONE_PICTURE, MatrixCell, axes_of, cells_in, examine, frozen_renderer
from brushexp.stress.painting import CANVAS, Exercise, check_painting, exercises
from brushexp.stress.reference import Reference, check_drawing
from brushexp.stress.report import draw_matrix, matrix_csv, matrix_text, outcome_counts
from brushexp.stress.scenes import SCENES, random_strokes, random_target
from brushexp.strokes.catalogue import Catalogue, check_strokes, drawable

SLOW_SCENES = ("50,000 on one pixel", "canvas 8192 x 64")  # the study alone has the time for them
QUICK = [name for name in SCENES if name not in SLOW_SCENES]
NAMES = [plugin.name for plugin in plugins("renderer")]
RENDERERS = {name: frozen_renderer(name) for name in NAMES}
BLENDS = {plugin.name: build_named("blend", plugin.name, {}) for plugin in plugins("blend")}
CELLS = [("tiled", dtype) for dtype in DTYPES] + [(name, "float32") for name in BLENDS if name != "tiled"]
FEW = 6  # strokes
# By how much float32 may differ from float64 all the same: a pixel, and a gradient against its size.
DEGRADED = {
    "windows 1e6 px away": (0.03, 0.3),  # float32 has steps of 1/16 px there
    "length 10,000 px": (1e-4, 0.01),  # textured: texels are a thousand times longer than wide
    "width 0": (1e-4, 1.0),  # topk: rounding decides which strokes are empty, and those have no gradient
}


def cells_of(renderer, blend, scene, dtypes):
    reference = Reference(RENDERERS[renderer], scene)
    return {dtype: check_drawing(RENDERERS[renderer], BLENDS[blend], reference, dtype) for dtype in dtypes}


@pytest.mark.parametrize("scene", QUICK)
def test_no_scene_breaks_a_formula(scene):
    drawn = SCENES[scene].scene(FEW)
    for renderer in (name for name in NAMES if RENDERERS[name].warm_up is None):
        reference = Reference(RENDERERS[renderer], drawn)
        for blend, dtype in CELLS:
            found = check_drawing(RENDERERS[renderer], BLENDS[blend], reference, dtype)
            assert found.outcome is not Outcome.broken, f"{renderer} {blend} {dtype}: {found}"
            if dtype == "float32":
                picture, gradient = DEGRADED.get(scene, (PICTURE_BOUNDS[dtype], GRADIENT_BOUNDS[dtype]))
                assert found.picture <= picture, f"{renderer} {blend}: {found}"
                assert found.gradient <= gradient, f"{renderer} {blend}: {found}"
            if (blend, dtype) == ("tiled", "float64"):
                assert found.outcome is Outcome.exact, f"{renderer}: {found}"


@pytest.mark.parametrize("scene", ["no strokes", "length 0", "length 10,000 px", "width 0", "1e6 px off the canvas"])
def test_no_scene_breaks_a_network(scene):
    drawn = SCENES[scene].scene(2)
    for renderer in (name for name in NAMES if RENDERERS[name].warm_up is not None):
        for dtype, found in cells_of(renderer, "tiled", drawn, ["float32", "float16"]).items():
            assert found.outcome is not Outcome.broken, f"{renderer} {dtype}: {found}"
            assert found.picture is None or found.picture <= FAINT, f"{renderer} {dtype}: {found}"


@pytest.mark.parametrize("name", exercises())
@pytest.mark.filterwarnings("ignore:.*in eval mode at the start of training")
def test_no_target_and_no_rate_spoils_the_strokes(name):
    exercise = exercises()[name]
    for renderer in (name for name in NAMES if RENDERERS[name].warm_up is None):
        short = replace(exercise, steps=min(exercise.steps, 40))
        found = check_painting(renderer, RENDERERS[renderer], BLENDS["tiled"], "float32", short, 60.0)
        assert found.outcome is Outcome.exact, f"{renderer}: {found}"


@pytest.mark.parametrize("dtype", ["bfloat16", "float16"])
def test_strokes_of_16_bits_are_drawn_in_float32_and_not_optimised(dtype):
    strokes = random_strokes(4, CANVAS).map(lambda value: value.to(DTYPES[dtype]).requires_grad_())
    image = Dense()(Analytic()(strokes), torch.arange(4), CANVAS, torch.zeros(3, dtype=DTYPES[dtype])).image
    image.sum().backward()
    assert image.dtype == torch.float32
    assert strokes.position.grad.dtype == DTYPES[dtype]
    found = check_painting("analytic", Analytic(), BLENDS["tiled"], dtype, Exercise(random_target(CANVAS), 2), 60.0)
    assert found.outcome is Outcome.refused
    assert "value.float()" in found.note


def test_strokes_that_a_precision_cannot_hold_are_refused():
    far = SCENES["1e6 px off the canvas"].scene(4).strokes
    with pytest.raises(UserError, match=r"position is .*inf.*make them in float32"):
        drawable(far.map(lambda value: value.half()))
    with pytest.raises(UserError, match="int64; convert them"):
        drawable(far.map(lambda value: value.long()))
    assert drawable(far) is far
    with pytest.raises(UserError, match="small steps are lost"):
        Catalogue(random_strokes(2, CANVAS).map(lambda value: value.bfloat16()), {})


@pytest.mark.parametrize("scene", SCENES)
def test_every_scene_has_strokes_in_range(scene):
    for most in (1, 24):
        drawn = SCENES[scene].scene(most)
        check_strokes(drawn.strokes)
        assert range_fault(drawn.strokes) == ""
        assert len(drawn.strokes) == min(drawn.wanted, most)
        assert drawn.target.shape == (3, *drawn.size)


def outcome_of(image, exact, gradient=None, exact_gradient=None, fault=""):
    given, true = ({} if g is None else {"opacity": g} for g in (gradient, exact_gradient))
    return compare(
        "float32", DrawnScene(image, given, 1.0, fault), DrawnScene(exact, true, 1.0), random_strokes(2, CANVAS)
    ).outcome


def test_outcomes_are_what_they_say():
    picture = torch.rand(3, 4, 5, dtype=torch.float64)
    slope = torch.tensor([1.0, -2.0], dtype=torch.float64)
    assert outcome_of(picture.float(), picture, slope.float(), slope) is Outcome.exact
    assert outcome_of(picture.float() + 2 * PICTURE_BOUNDS["float32"], picture) is Outcome.degraded
    assert outcome_of(picture, picture, slope * (1 + 2 * GRADIENT_BOUNDS["float32"]), slope) is Outcome.degraded
    assert outcome_of(picture * torch.nan, picture) is Outcome.broken
    assert outcome_of(picture + 1, picture) is Outcome.broken
    assert outcome_of(picture, picture, slope * torch.inf, slope) is Outcome.broken
    assert outcome_of(picture, picture, fault="alpha is not finite") is Outcome.broken


def test_a_crash_is_a_bug_and_a_message_is_none():
    class Crashing(Analytic):
        def forward(self, strokes, number=None):
            raise RuntimeError("expected scalar type Float\nbut found Half")

    scene = SCENES["one stroke"].scene(1)
    reference = Reference(Analytic(), scene)
    found = check_drawing(Crashing(), BLENDS["tiled"], reference, "float32")
    assert found == Check(Outcome.broken, note="RuntimeError: expected scalar type Float")
    far = Reference(Analytic(), SCENES["1e6 px off the canvas"].scene(2))
    assert check_drawing(Analytic(), BLENDS["tiled"], far, "float16").outcome is Outcome.refused


def test_the_matrix_goes_through_all_that_is_registered():
    axes = axes_of(None, None, None, None)
    assert set(axes.renderers) == set(NAMES)
    assert set(axes.blends) == set(BLENDS)
    assert cells_in(axes) == len(NAMES) * len(BLENDS) * len(DTYPES) * (len(SCENES) + len(exercises()))
    with pytest.raises(UserError, match=r"blends has no 'tilde'.*tiled"):
        axes_of(None, ["tilde"], None, None)


@pytest.mark.filterwarnings("ignore:.*in eval mode at the start of training")
def test_the_report_has_every_cell_and_every_message(tmp_path):
    axes = axes_of(["analytic"], ["tiled", "dense"], ["float32", "float16"], ["1e6 px off the canvas", "target 0"])
    cells = list(examine(axes, 0.1))
    assert len(cells) == cells_in(axes) == 12
    assert {cell.kind for cell in cells} == {ONE_PICTURE, MANY_STEPS}
    broken = MatrixCell(
        ONE_PICTURE, "target 0", "analytic", "mine", "float32", Check(Outcome.broken, note="alpha is 2")
    )
    others = [replace(cell, blend="mine") for cell in cells if cell.kind == ONE_PICTURE and cell.blend == "tiled"]
    others = [cell for cell in others if (cell.scene, cell.dtype) != ("target 0", "float32")]
    every = [*cells, broken, *others]
    assert sum(outcome_counts(every).values()) == len(every)
    assert outcome_counts(every)["n_broken"] == 1
    assert len(matrix_csv(every).splitlines()) == len(every) + 1
    text = matrix_text(every)
    assert "| scene | tiled float32 |" in text
    assert "broken [" in text
    assert "alpha is 2" in text
    assert "make them in float32" in text
    draw_matrix(every, tmp_path / "extremes.png")
    assert (tmp_path / "extremes.png").stat().st_size > 5000
