"""Test that plans list the strokes and dips of a painting, and that playing a plan back reproduces the painting."""

import csv
from dataclasses import replace

import catalogues
import numpy as np
import pytest
import torch
from brushexp_changes.tubes import pages
from brushexp_changes.tubes.amounts import hours_of, millilitres_of_mixtures, millilitres_of_tubes
from brushexp_changes.tubes.difference import median_difference
from brushexp_changes.tubes.mixtures import all_mixtures, choose_mixtures
from brushexp_changes.tubes.paints import load_tubes
from brushexp_changes.tubes.plan import DRIEST, Plan, labels_of, merge_slivers, numbered_regions, plan_of
from brushexp_changes.tubes.recorded import recorded_plan
from brushexp_changes.tubes.sheets import DIFFICULTIES, PlanSheets, difference_from, remarks_on, title_of
from brushexp_changes.tubes.table import Table
from omegaconf import OmegaConf
from refusals import refuses
from scenes import random_strokes, straight
from test_paints import CANVAS

from brushexp.errors import UserError
from brushexp.plugins.export.base import ExportJob
from brushexp.registry import build_named
from brushexp.strokes.bezier import curve_of, half_width_of, length_of, strokes_along
from brushexp.strokes.catalogue import Strokes

SIZE = (48, 72)
TUBES = {"tubes": "zorn", "mixtures": 6, "brushes": [40.0, 20.0], "width_cm": 30.0, "load": 6.0}


def two_brushes(brushes=(12.0, 6.0), load: float = 6.0) -> Table:
    picture = torch.rand(3, *CANVAS, generator=torch.Generator().manual_seed(3))
    return Table(choose_mixtures(all_mixtures(load_tubes("zorn")), picture, 6), torch.tensor(brushes), load)


def job_of(strokes: Strokes, **tubes) -> ExportJob:
    job = catalogues.job_of(strokes, CANVAS, background=torch.ones(3), source="a/catalogue.h5")
    config = OmegaConf.to_yaml({"change": {"tubes": tubes}} if tubes else {})
    return replace(job, saved=replace(job.saved, config=config))


def planned(strokes: Strokes, **options) -> Plan:
    return plan_of(job_of(strokes), two_brushes(**options), 0.3)


def painted(n: int = 40) -> Strokes:
    own = two_brushes()
    return own.with_mixtures(own.with_brushes(random_strokes(n, CANVAS)))


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
    np.testing.assert_array_equal(plan.play_back().picture(), laid.picture())


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
    played = planned(stroke, brushes=(8.0,)).play_back()
    row = played.picture()[30, :, 0].astype(int)
    assert row[12] <= round(255 * float(black.max())) + 1
    assert row[12] < row[45] < row[56] < 255
    ink = (255 - row[56]) / (255 - row[12])
    assert DRIEST - 0.02 <= ink <= DRIEST + 0.2


@pytest.mark.parametrize("n", [0, 1, 25])
def test_the_sheets_are_a_pdf_and_the_table_has_the_strokes(tmp_path, n):
    job = job_of(painted(n), **TUBES)
    pdf, strokes = PlanSheets(scale=0.3).write(job, tmp_path)
    data = pdf.read_bytes()
    assert data.startswith(b"%PDF-")
    (again := tmp_path / "again").mkdir()
    assert PlanSheets(scale=0.3).write(job, again)[0].read_bytes() == data
    rows = list(csv.DictReader(strokes.read_text().splitlines()))
    assert len(rows) == n
    plan, own = recorded_plan(job, {})
    assert own == (n > 0)
    curves = curve_of(plan.strokes).flatten(1) / plan.pixels_per_mm
    for row, curve in zip(rows, curves.tolist(), strict=True):
        assert [float(row[name]) for name in ("x1_mm", "y1_mm", "x2_mm", "y2_mm", "x3_mm", "y3_mm")] == pytest.approx(
            curve, abs=0.006
        )


def test_a_painting_of_other_tasks_gets_its_table_afterwards_and_one_of_its_own_is_checked(tmp_path, monkeypatch):
    job = job_of(random_strokes(30, CANVAS))
    plan, own = recorded_plan(job, {"tubes": "primaries", "mixtures": 3, "brushes": [60.0]})
    assert not own
    assert len(plan.table.mixtures) <= 3
    assert plan.table.mixtures.tubes == load_tubes("primaries").names
    assert {stage.brush_mm for stage in plan.stages} == {60.0}
    refuses("width_cm=-3 is not above 0", recorded_plan, job_of(painted(3), **{**TUBES, "width_cm": -3.0}), {})
    refuses(r"give to\.plan\.tubes=eight", recorded_plan, job_of(painted(3), **{**TUBES, "brushes": "broad"}), {})
    monkeypatch.setattr(pages, "MOST_PAGES", 3)
    with pytest.raises(UserError, match=r"pages, more than 3; set to\.plan\.scale="):
        PlanSheets(scale=9.0, width_cm=60.0).write(job_of(painted(3), **TUBES), tmp_path)
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

    plan, _ = recorded_plan(job_of(painted(), **TUBES), {})
    picture = plan.play_back().picture()
    io.imsave(tmp_path / "same.png", picture, check_contrast=False)
    io.imsave(tmp_path / "other.png", picture[:30], check_contrast=False)
    assert difference_from(plan, str(tmp_path / "same.png")) == pytest.approx(0, abs=0.05)
    with pytest.raises(UserError, match="give one with the same aspect ratio"):
        difference_from(plan, str(tmp_path / "other.png"))
    picture = torch.rand(3, 5, 6)
    assert median_difference(picture, picture) == 0
    assert median_difference(picture, 1 - picture) > 5


def parts_of(regions: np.ndarray) -> list[np.ndarray]:
    from scipy.ndimage import label  # noqa: PLC0415

    found = []
    for number in np.unique(regions):
        parts, count = label(regions == number, structure=np.ones((3, 3)))
        found += [parts == k for k in range(1, count + 1)]
    return found


def test_slivers_and_spots_go_to_what_is_beside_them_and_broad_parts_stay():
    regions = np.zeros((60, 80), dtype=int)
    regions[:, 40:] = 1
    regions[20:22] = 2  # a line
    regions[40:45, 10:15] = 3  # a spot
    regions[30:60, 60:80] = 4
    merged = merge_slivers(regions, 8.0)
    assert set(np.unique(merged)) == {0, 1, 4}
    assert (merged[regions == 4] == 4).mean() > 0.95
    assert (merged[20:22, :38] == 0).all()
    assert (merged[20:22, 42:] == 1).all()
    noise = np.random.default_rng(0).integers(0, 3, (60, 80))
    noise[10:40, 10:50] = 1
    for side in (3.0, 6.0):
        assert min(part.sum() for part in parts_of(merge_slivers(noise, side))) >= side**2
    np.testing.assert_array_equal(merge_slivers(noise, 100.0), noise, "nothing is broad enough to stay")


def test_a_plan_grows_stage_by_stage_to_what_is_played_back():
    plan = planned(painted())
    pictures = [plan.after(stage.last).picture() for stage in plan.stages]
    np.testing.assert_array_equal(pictures[-1], plan.play_back().picture())
    ground = plan.after(0).picture()
    changes = [np.abs(a.astype(int) - b).sum() for a, b in zip([ground, *pictures], pictures, strict=False)]
    assert changes[0] > 0
    assert len(changes) == len(plan.stages)


def test_amounts_of_paint_and_hours_follow_what_is_painted():
    plan = planned(painted())
    area = sum(stage.metres * 1000 * stage.brush_mm for stage in plan.stages)  # mm^2
    assert millilitres_of_mixtures(plan).sum() == pytest.approx(area * 0.2 * 1.5 / 1000)
    assert sum(millilitres_of_tubes(plan).values()) == pytest.approx(millilitres_of_mixtures(plan).sum())
    used = {stage.mixture for stage in plan.stages}
    seconds = 4 * 40 + 5 * plan.dips + 300 * len(used) + 90 * len(plan.stages)
    assert hours_of(plan) == pytest.approx(seconds / 3600)


def test_an_easier_plan_has_fewer_mixtures_brushes_and_strokes(tmp_path, caplog):
    caplog.set_level("INFO")
    job = job_of(painted(200), **{**TUBES, "mixtures": 20})
    counts = []
    for number, difficulty in enumerate(DIFFICULTIES):
        (folder := tmp_path / difficulty).mkdir()
        _, table = PlanSheets(difficulty=difficulty, scale=0.3).write(job, folder)
        rows = list(csv.DictReader(table.read_text().splitlines()))
        counts.append(len(rows))
        mixtures, brushes = ({row[name] for row in rows} for name in ("mixture", "brush_mm"))
        assert len(mixtures) <= (8, 12, 24)[number]
        assert brushes <= ({"25", "12"}, {"25", "12", "6"}, {"40", "20"})[number]
    assert counts == sorted(counts)
    assert counts[0] < 200
    refuses("to.plan.difficulty=fun does not exist; choose one of", build_named, "to", "plan", {"difficulty": "fun"})
    words = " ".join([*remarks_on(*recorded_plan(job, {})), title_of(job)])
    assert "hours" in words
    assert "ml of paint" in words
    assert "CIEDE2000" not in words
    assert "catalogue" not in words


def test_a_plan_is_named_by_its_picture():
    job = job_of(painted(3), **TUBES)
    config = OmegaConf.to_yaml({"image": "photos/grandma.jpg"})
    assert title_of(replace(job, saved=replace(job.saved, config=config))) == "To paint: grandma"
    assert title_of(job) == "To paint"
