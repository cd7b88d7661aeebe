"""Paints mix as paints do, strokes keep to what a table has, and a plan of them, played back, is the painting."""

import csv
import time
from dataclasses import replace
from itertools import groupby

import catalogues
import numpy as np
import pytest
import torch
from brushexp_tubes import task
from brushexp_tubes.difference import median_difference
from brushexp_tubes.mixtures import all_mixtures, choose_mixtures, differences, within_tones
from brushexp_tubes.paints import SETS, load_tubes, seen
from brushexp_tubes.plan import DRIEST, Plan, labels_of, numbered_regions, plan_of
from brushexp_tubes.recorded import recorded_plan
from brushexp_tubes.sheets import PlanSheets
from brushexp_tubes.table import StageOrder, Table
from brushexp_tubes.task import Constraint, build_constrained, wanted_colors
from omegaconf import OmegaConf
from refusals import refuses
from scenes import random_strokes, straight, with_shapes

from brushexp.api.settings import settings_of
from brushexp.cli.program import expand_arguments
from brushexp.config.check import check
from brushexp.config.compose import composed
from brushexp.config.looks import look_names
from brushexp.config.tasks import task_for
from brushexp.errors import UserError
from brushexp.painting.components import standard_components
from brushexp.painting.stroke_optimizer import StrokeOptimizer
from brushexp.pictures.color import to_lab
from brushexp.plugins.export.base import ExportJob
from brushexp.plugins.order.base import Order
from brushexp.registry import build_named
from brushexp.runs.runner import perform
from brushexp.strokes.bezier import curve_of, half_width_of, length_of, strokes_along
from brushexp.strokes.catalogue import LATER_FIELDS, Catalogue, Strokes
from brushexp.strokes.storage import load_catalogue

SIZE = (48, 72)
EIGHT = load_tubes("eight")
QUIET = {"frames": 0, "report": False, "logger": [], "threads": 1}


def table(count: int = 6, brushes=(9.0, 4.0), load: float = 8.0) -> Table:
    picture = torch.rand(3, *SIZE, generator=torch.Generator().manual_seed(3))
    return Table(choose_mixtures(all_mixtures(EIGHT), picture, count), torch.tensor(brushes), load)


def test_strokes_have_the_nearest_mixture_and_brush_of_a_table_and_no_more_paint_than_a_load():
    own, strokes = table(), random_strokes(12, SIZE)
    from skimage.color import deltaE_ciede2000  # noqa: PLC0415

    mixtures = to_lab(own.mixtures.color.double().numpy())
    for color, mixture in zip(
        to_lab(strokes.color.double().numpy()), own.mixture_of(strokes.color).tolist(), strict=True
    ):
        away = [float(deltaE_ciede2000(color, other)) for other in mixtures]
        assert away[mixture] == pytest.approx(min(away), abs=1e-4)
    for width, brush in zip((2 * half_width_of(strokes)).tolist(), own.brush_of(strokes).tolist(), strict=True):
        ratios = [max(width / other, other / width) for other in own.brushes.tolist()]
        assert ratios[brush] == pytest.approx(min(ratios), rel=1e-5)
    own = table(load=2.0)
    strokes = own.mixed(own.sized(with_shapes(random_strokes(40, SIZE))))
    width = 2 * half_width_of(strokes)
    assert (width[:, None] - own.brushes).abs().amin(1).max() < 1e-4
    assert (length_of(curve_of(strokes)) <= 2 * width * 1.001).all()
    assert (strokes.opacity == 1).all()
    assert not any(getattr(strokes, name).any() for name in LATER_FIELDS)
    again = own.mixed(own.sized(strokes))
    for (name, value), (_, same) in zip(strokes.items(), again.items(), strict=True):
        torch.testing.assert_close(value, same, msg=name)


def painter_of(strokes: Strokes, own: Table, target=None) -> StrokeOptimizer:
    target = torch.rand(3, *SIZE, generator=torch.Generator().manual_seed(0)) if target is None else target
    parts = standard_components(steps=20, order=StageOrder(own))
    painter = StrokeOptimizer(Catalogue(strokes, parts.optimizer.units), parts, target, torch.ones(3), seed=0)
    painter.limit = Constraint(painter, own)
    return painter


def test_wanted_colours_lower_the_squared_error_of_all_strokes_at_once():
    own = table()
    strokes = own.mixed(own.sized(random_strokes(60, SIZE, seed=2)))
    painter, errors = painter_of(strokes, own), []
    order = painter.components.order
    painter.components = replace(painter.components, order=Kept(order.depth(strokes, None)))
    painter.depth.renew(strokes)
    for _ in range(6):
        picture = painter.picture.draw(strokes, painter.front_to_back)
        errors.append(float((picture - painter.picture.target).square().sum()))
        strokes = replace(strokes, color=wanted_colors(painter, strokes))
    assert errors == sorted(errors, reverse=True)
    assert errors[-1] < 0.95 * errors[0]


class Kept(Order):
    """Depth that colours do not change."""

    def __init__(self, depth: torch.Tensor) -> None:
        self.kept = depth

    def depth(self, strokes: Strokes, accuracy: torch.Tensor | None) -> torch.Tensor:
        return self.kept


def test_colours_are_free_at_first_and_those_of_mixtures_in_the_end():
    own = table()
    painter = painter_of(random_strokes(30, SIZE), own)
    colors = own.mixtures.color

    def apart() -> float:
        return float(torch.cdist(painter.strokes().color, colors).amin(1).max())

    assert apart() > 0.05
    painter.schedule.step = 20
    assert apart() == 0
    painter.schedule.step, painter.stop = 0, "interrupted"
    assert apart() == 0, "a painting that is stopped can be painted, too"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Folder of a small painting with tubes."""
    folder = tmp_path_factory.mktemp("tubes")
    words = ["chelsea", "tubes=zorn", "mixtures=5", "brushes=[40,20]", "strokes=60", "steps=20", "resolution=64"]
    cfg = composed(
        expand_arguments([*words, *(f"{key}={value}".replace("False", "false") for key, value in QUIET.items())])
    )
    assert cfg.task == "tubes"
    check(cfg, words)
    perform(task, cfg, folder, time.monotonic())
    return folder


def test_a_painting_with_tubes_has_their_mixtures_and_brushes_in_the_order_of_stages(folder):
    saved = load_catalogue(folder / "catalogue.h5")
    colors = torch.unique(saved.strokes.color, dim=0)
    assert len(colors) <= 5
    known = all_mixtures(load_tubes("zorn")).color
    assert torch.cdist(colors, known).amin(1).max() < 1e-4
    mm = 2 * half_width_of(saved.strokes) * 300 / saved.size[1]
    assert torch.minimum((mm - 40).abs(), (mm - 20).abs()).max() < 0.01
    bottom_up = saved.depth.argsort()
    kinds = [(round(float(mm[k])), tuple(saved.strokes.color[k].tolist())) for k in bottom_up.tolist()]
    runs = [kind for kind, _ in groupby(kinds)]
    assert len(runs) == len(set(runs))
    assert [width for width, _ in runs] == sorted((width for width, _ in runs), reverse=True)


@pytest.mark.parametrize("options", [
    {"tubes": "one.csv", "brushes": [60.0], "strokes": 1},
    {"tubes": "zorn", "brushes": [60.0], "mixtures": 1, "strokes": 20, "steps": 0},
    {"tubes": "zorn", "brushes": [60.0, 60.0, 30.0], "mixtures": 3, "strokes": 20, "density": "traced"},
])  # fmt: skip
def test_one_tube_one_brush_one_stroke(tmp_path, monkeypatch, options):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "one.csv").write_text("tube,color\nochre,#ac7726\n")
    settings = settings_of("tubes", {"image": "chelsea", "resolution": 48, "steps": 12, **options, **QUIET})
    painter = build_constrained(settings.cfg)
    painter.schedule.step = painter.schedule.steps
    strokes = painter.strokes()
    assert len(strokes) >= 1
    assert len(torch.unique(strokes.color, dim=0)) <= options.get("mixtures", 1)
    assert torch.isfinite(painter.draw_whole()).all()


def test_a_table_of_a_spreadsheet_is_read_with_its_mark_and_one_in_other_letters_is_refused_in_words(tmp_path):
    path = tmp_path / "own.csv"
    path.write_bytes("tube,color\nÖl,#ffffff\n".encode("utf-8-sig"))
    assert load_tubes(str(path)).names == ("Öl",)
    path.write_bytes("tube,color\nÖl,#ffffff\n".encode("latin-1"))
    refuses(r"own\.csv is damaged .* save it as CSV in UTF-8", load_tubes, str(path))


@pytest.mark.parametrize(("words", "message"), [
    ({"brushes": [0.5]}, "pixels wide; set resolution="),
    ({"brushes": []}, "leaves nothing to paint with"),
    ({"wet": 0.5}, "drop wet, or drop tubes"),
    ({"color": "pigment"}, "paint of tubes= is opaque"),
    ({"painter": "hertzmann"}, "is for painter=gradient"),
    ({"tubes": "eigth"}, "is no file and no set"),
])  # fmt: skip
def test_what_no_table_has_is_refused_in_words(words, message):
    refuses(message, settings_of, "tubes", {"image": "chelsea", "resolution": 64, **words})


def test_tubes_and_the_look_ask_for_the_task_and_a_set_that_is_not_there_is_refused():
    assert task_for("paint", {"tubes": "zorn"}) == task_for("paint", {"look": "tubes"}) == "tubes"
    assert task_for("paint", {"look": "oil"}) == "paint"
    assert "tubes" not in look_names()
    for words in ({"look": "tubes"}, {"tubes": "zorn"}):
        refuses("task=paint leaves this to task=tubes", settings_of, "paint", {"image": "chelsea", **words})
    refuses("tubes=zurn is no file and no set; choose one of acrylics, eight, ", load_tubes, "zurn")


@pytest.mark.parametrize("name", SETS)
def test_mixtures_do_not_depend_on_how_much_is_mixed_and_stay_between_their_tubes(name):
    tubes = load_tubes(name)
    parts = np.random.default_rng(0).integers(0, 5, (50, len(tubes))) + np.eye(len(tubes), dtype=int)[[0] * 50]
    mixed = tubes.mix(parts)
    np.testing.assert_allclose(tubes.mix(3 * parts), mixed, atol=1e-12)
    assert (mixed >= 0).all()
    assert (mixed <= 1).all()
    pure = to_lab(tubes.mix(np.eye(len(tubes))))[:, 0]
    lightness = to_lab(mixed)[:, 0]
    assert (lightness >= pure.min() - 0.5).all()
    assert (lightness <= pure.max() + 0.5).all()


def test_paints_make_what_painters_know_white_is_white_and_every_mixture_is_listed_once():
    def mix(**parts: int) -> np.ndarray:
        names = [name.replace(" ", "_") for name in EIGHT.names]
        return EIGHT.mix(np.array([[parts.get(name, 0) for name in names]]))[0]

    red, green, blue = mix(hansa_yellow_opaque=1, phthalo_green_blue_shade=1)
    assert green > red > blue or green > blue > red
    grey = to_lab(mix(titanium_white=4, bone_black=1)[None])[0]
    assert np.hypot(*grey[1:]) < 5
    tint = to_lab(np.stack([mix(ultramarine_blue=1), mix(ultramarine_blue=1, titanium_white=8)]))
    assert tint[1, 0] > tint[0, 0] + 30
    np.testing.assert_allclose(seen(np.array([[1.0] * 16, [0.0] * 16])), [[1] * 3, [0] * 3], atol=1e-6)
    mixtures = all_mixtures(load_tubes("zorn"))
    shares = mixtures.parts / mixtures.parts.sum(1, keepdims=True)
    assert len(np.unique(shares.round(9), axis=0)) == len(mixtures)
    assert ((mixtures.parts > 0).sum(1) <= 3).all()
    assert mixtures.recipe(0) == "titanium white"
    assert len(all_mixtures(replace_names(1))) == 1


def test_a_file_of_reflectances_and_one_of_colours_are_read(tmp_path):
    waves = range(400, 701, 20)
    flat = tmp_path / "flat.csv"
    flat.write_text("tube," + ",".join(f"R{w}" for w in waves) + "\ngrey," + ",".join(["0.2"] * 16) + "\n")
    (grey,) = load_tubes(str(flat)).mix(np.ones((1, 1)))
    assert grey == pytest.approx([seen(np.full((1, 16), 0.2))[0, 0]] * 3, abs=1e-6)
    colors = tmp_path / "colors.csv"
    colors.write_text("tube,color\nwhite,#ffffff\nblue,#1a4fc0\n")
    pure = load_tubes(str(colors)).mix(np.eye(2))
    np.testing.assert_allclose(pure, [[1, 1, 1], [0x1A / 255, 0x4F / 255, 0xC0 / 255]], atol=2e-3)


@pytest.mark.parametrize(("text", "message"), [
    ("name,color\na,red\n", "a name in the column tube"),
    ("tube,color\n", "give 1 to 24 tubes"),
    ("tube,color\na,reddish\n", "cannot be read"),
    ("tube,R400\na,0.5\n", "R700 in steps of 20"),
    ("tube,size\na,0.5\n", "cannot be read"),
])  # fmt: skip
def test_files_that_are_no_tubes_are_refused_in_words(tmp_path, text, message):
    (tmp_path / "own.csv").write_text(text)
    refuses(message, load_tubes, str(tmp_path / "own.csv"))


def replace_names(count: int):
    return replace(
        EIGHT, names=EIGHT.names[:count], mix=lambda parts: EIGHT.mix(np.pad(parts, ((0, 0), (0, 8 - count))))
    )


def test_chosen_mixtures_are_as_good_as_any_pair_more_are_nearer_and_tones_lie_between_those_of_the_paints():
    few = all_mixtures(load_tubes("zorn"))[np.arange(0, 200, 9)]
    picture = few.color[[2, 7]].T.reshape(3, 1, 2).repeat(1, 4, 3)
    chosen = choose_mixtures(few, picture, 2)
    torch.testing.assert_close(chosen.color.sort(0)[0], few.color[[2, 7]].sort(0)[0])
    one = choose_mixtures(few, picture, 1)
    every = differences(picture.flatten(1).T.double().numpy(), few.color.double().numpy()).mean(0)
    mine = differences(picture.flatten(1).T.double().numpy(), one.color.double().numpy()).mean()
    assert mine == pytest.approx(every.min(), abs=0.2)
    picture = torch.rand(3, 20, 20, generator=torch.Generator().manual_seed(1))
    colors = picture.flatten(1).T.double().numpy()
    near = []
    for count in (1, 4, 16):
        chosen = choose_mixtures(all_mixtures(EIGHT), picture, count)
        assert 1 <= len(chosen) <= count
        near.append(differences(colors, chosen.color.double().numpy()).min(1).mean())
    assert near == sorted(near, reverse=True)
    mixtures = all_mixtures(EIGHT)
    picture = torch.tensor([0.0, 0.5, 1.0]).expand(3, 1, 3)
    lightness = to_lab(within_tones(picture, mixtures).flatten(1).T.double().numpy())[:, 0]
    of_paints = to_lab(EIGHT.mix(np.eye(8)))[:2, 0]  # white and black
    assert lightness[[0, 2]] == pytest.approx([of_paints[1], of_paints[0]], abs=1.5)
    assert lightness[0] < lightness[1] < lightness[2]


@pytest.mark.parametrize("tubes", ["zorn", "primaries"])
def test_a_palette_of_pigments_has_colours_that_can_be_mixed(tubes):
    picture = torch.rand(3, 20, 30, generator=torch.Generator().manual_seed(0))
    picture[:, 0, 0] = torch.tensor([0.1, 0.2, 0.9])
    painted = build_named("palette", "pigments", {"tubes": tubes})(picture)
    assert painted.shape == picture.shape
    colors = painted.flatten(1).T.double().numpy()
    assert 0 <= colors.min() <= colors.max() <= 1
    mixtures = all_mixtures(load_tubes(tubes)).color.double().numpy()
    assert np.median(differences(colors, mixtures).min(1)) < 2
    assert (to_lab(colors[:1])[0, 2] < -25) == (tubes == "primaries"), "Zorn's black is his blue"


CANVAS = (60, 90)
SETTINGS = {"tubes": "zorn", "mixtures": 6, "brushes": [40.0, 20.0], "width_cm": 30.0, "load": 6.0}


def two_brushes(brushes=(12.0, 6.0), load: float = 6.0) -> Table:
    picture = torch.rand(3, *CANVAS, generator=torch.Generator().manual_seed(3))
    return Table(choose_mixtures(all_mixtures(load_tubes("zorn")), picture, 6), torch.tensor(brushes), load)


def job_of(strokes: Strokes, **settings) -> ExportJob:
    job = catalogues.job_of(strokes, CANVAS, background=torch.ones(3), source="a/catalogue.h5")
    return replace(job, saved=replace(job.saved, config=OmegaConf.to_yaml(settings)))


def planned(strokes: Strokes, **options) -> Plan:
    return plan_of(job_of(strokes), two_brushes(**options), 0.3)


def painted(n: int = 40) -> Strokes:
    own = two_brushes()
    return own.mixed(own.sized(random_strokes(n, CANVAS)))


def test_a_plan_has_every_stroke_once_in_stages_and_is_the_painting_where_its_brushes_never_run_dry():
    plan = planned(painted())
    assert sorted(plan.order.tolist()) == list(range(40))
    assert (plan.stage.diff() >= 0).all()
    assert [stage.first for stage in plan.stages[1:]] == [stage.last for stage in plan.stages[:-1]]
    assert plan.stages[-1].last == 40
    for stage in plan.stages:
        rows = plan.strokes[slice(stage.first, stage.last)]
        assert len(torch.unique(rows.color, dim=0)) == 1
        assert float(2 * half_width_of(rows)[0]) == pytest.approx(stage.brush_mm * 0.3, rel=1e-3)
    lengths = length_of(curve_of(plan.strokes)).sum() / 0.3 / 1000
    assert plan.metres == pytest.approx(float(lengths), rel=1e-5)
    plan = planned(painted(), load=1000.0)
    order = plan.stage.new_empty(40)
    order[plan.order] = torch.arange(40)
    job = plan.job
    laid = replace(job, saved=replace(job.saved, depth=order.int()))
    np.testing.assert_array_equal(plan.played().picture(), laid.picture())


def test_brushes_are_dipped_at_every_stage_and_where_a_load_does_not_last_and_a_long_stroke_runs_dry():
    plan = planned(painted(200))
    length = length_of(curve_of(plan.strokes)).numpy()
    load = 6.0 * 2 * half_width_of(plan.strokes).numpy()
    begins = np.isin(np.arange(200), [stage.first for stage in plan.stages])
    assert (plan.used[begins] == 0).all()
    assert (plan.used + length <= load * 1.001).all()
    early = np.flatnonzero((plan.used == 0) & ~begins)
    assert len(early) > 3
    assert (plan.used[early - 1] + length[early - 1] + length[early] > load[early]).all()
    assert plan.dips == (plan.used == 0).sum()
    own = two_brushes(brushes=(8.0,))
    black = own.mixtures.color[:1]
    stroke = strokes_along(torch.tensor([[[10.0, 30], [34, 30], [58, 30]]]), 8.0, black, 1.0)
    played = planned(stroke, brushes=(8.0,)).played()
    row = played.picture()[30, :, 0].astype(int)
    assert row[12] <= round(255 * float(black.max())) + 1
    assert row[12] < row[45] < row[56] < 255
    ink = (255 - row[56]) / (255 - row[12])
    assert DRIEST - 0.02 <= ink <= DRIEST + 0.2


@pytest.mark.parametrize("n", [0, 1, 25])
def test_the_sheets_are_a_pdf_and_the_table_has_the_strokes(tmp_path, n):
    job = job_of(painted(n), **SETTINGS)
    pdf, strokes = PlanSheets(scale=0.3).write(job, tmp_path)
    data = pdf.read_bytes()
    assert data.startswith(b"%PDF-")
    rows = list(csv.DictReader(strokes.read_text().splitlines()))
    assert len(rows) == n
    plan, own = recorded_plan(job, {})
    assert own == (n > 0)
    curves = curve_of(plan.strokes).flatten(1) / plan.pixels_per_mm
    for row, curve in zip(rows, curves.tolist(), strict=True):
        assert [float(row[name]) for name in ("x1_mm", "y1_mm", "x2_mm", "y2_mm", "x3_mm", "y3_mm")] == pytest.approx(
            curve, abs=0.006
        )


def test_a_painting_of_other_tasks_gets_its_table_afterwards_and_one_of_its_own_is_checked(tmp_path):
    job = job_of(random_strokes(30, CANVAS))
    plan, own = recorded_plan(job, {"tubes": "primaries", "mixtures": 3, "brushes": [60.0]})
    assert not own
    assert len(plan.table.mixtures) <= 3
    assert plan.table.mixtures.tubes == load_tubes("primaries").names
    assert {stage.brush_mm for stage in plan.stages} == {60.0}
    refuses("width_cm=-3 is not above 0", recorded_plan, job_of(painted(3), **{**SETTINGS, "width_cm": -3.0}), {})
    refuses(r"give to\.plan\.tubes=eight", recorded_plan, job_of(painted(3), **{**SETTINGS, "brushes": "broad"}), {})
    with pytest.raises(UserError, match=r"pages, more than 400; set to\.plan\.scale="):
        PlanSheets(scale=9.0, width_cm=60.0).write(job_of(painted(3), **SETTINGS), tmp_path)
    assert not list(tmp_path.iterdir())


def test_each_region_has_a_number_inside_it_and_the_difference_from_a_target_is_told(tmp_path):
    plan = planned(Strokes.join(straight((0.0, 30.0), (90.0, 30.0), width=60.0), painted(5)))
    regions = numbered_regions(plan)
    assert regions.shape == CANVAS
    for number in np.unique(regions):
        places = list(labels_of(regions == number))
        assert places
        assert all(regions[row, column] == number for row, column, _ in places)
    from skimage import io  # noqa: PLC0415

    plan, own = recorded_plan(job_of(painted(), **SETTINGS), {})
    picture = plan.played().picture()
    io.imsave(tmp_path / "same.png", picture, check_contrast=False)
    io.imsave(tmp_path / "other.png", picture[:30], check_contrast=False)
    assert "CIEDE2000 0.0 " in PlanSheets(target=str(tmp_path / "same.png")).remarks(plan, own)[-1]
    with pytest.raises(UserError, match=r"give its target\.png"):
        PlanSheets(target=str(tmp_path / "other.png")).remarks(plan, own)
    picture = torch.rand(3, 5, 6)
    assert median_difference(picture, picture) == 0
    assert median_difference(picture, 1 - picture) > 5
