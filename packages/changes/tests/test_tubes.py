"""Test that strokes use only the tubes and brushes of a table."""

import time
from dataclasses import replace
from itertools import groupby

import pytest
import torch
from brushexp_changes.tubes.mixtures import all_mixtures, choose_mixtures
from brushexp_changes.tubes.paints import load_tubes
from brushexp_changes.tubes.table import StageOrder, Table
from brushexp_changes.tubes.tubes import OfTubes, best_colors
from refusals import refuses
from scenes import random_strokes, with_shapes
from test_painting_plans import SIZE
from test_paints import EIGHT

from brushexp.api.settings import settings_of
from brushexp.cli.program import expand_arguments
from brushexp.config.check import check
from brushexp.config.compose import compose_config
from brushexp.painting.build import build_painter
from brushexp.painting.components import standard_components
from brushexp.painting.stroke_optimizer import StrokeOptimizer
from brushexp.pictures.color import to_lab
from brushexp.plugins.order.base import front_to_back
from brushexp.registry import plugin_of
from brushexp.runs.runner import perform
from brushexp.strokes.bezier import curve_of, half_width_of, length_of
from brushexp.strokes.catalogue import LATER_FIELDS, Catalogue, Strokes
from brushexp.strokes.storage import load_catalogue
from brushexp.system.status import Status
from brushexp.tasks import paint

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
    strokes = own.with_mixtures(own.with_brushes(with_shapes(random_strokes(40, SIZE))))
    width = 2 * half_width_of(strokes)
    assert (width[:, None] - own.brushes).abs().amin(1).max() < 1e-4
    assert (length_of(curve_of(strokes)) <= 2 * width * 1.001).all()
    assert (strokes.opacity == 1).all()
    assert not any(getattr(strokes, name).any() for name in LATER_FIELDS)
    again = own.with_mixtures(own.with_brushes(strokes))
    for (name, value), (_, same) in zip(strokes.items(), again.items(), strict=True):
        torch.testing.assert_close(value, same, msg=name)


def painter_of(strokes: Strokes, change: OfTubes) -> StrokeOptimizer:
    target = change.target(torch.rand(3, *SIZE, generator=torch.Generator().manual_seed(0)))
    parts = standard_components(steps=20)
    parts = replace(parts, order=change.order(parts.order))
    catalogue = Catalogue(strokes, parts.optimizer.units)
    return StrokeOptimizer(catalogue, parts, target, torch.ones(3), seed=0, changes={"tubes": change})


def test_best_colours_lower_the_squared_error_of_all_strokes_at_once():
    own = table()
    strokes = own.with_mixtures(own.with_brushes(random_strokes(60, SIZE, seed=2)))
    state, errors = painter_of(strokes, OfTubes()).now(), []
    order = front_to_back(StageOrder(own).depth(strokes, None))
    state = replace(state, order=lambda _: order)  # an order that does not depend on colours
    for _ in range(6):
        errors.append(float((state.draw(strokes, order) - state.target).square().sum()))
        strokes = replace(strokes, color=best_colors(strokes, state))
    assert errors == sorted(errors, reverse=True)
    assert errors[-1] < 0.95 * errors[0]


def test_colours_are_free_at_first_and_those_of_mixtures_in_the_end():
    change = OfTubes(mixtures=6)
    painter = painter_of(random_strokes(30, SIZE), change)
    colors = choose_mixtures(all_mixtures(EIGHT), painter.picture.target, 6).color

    def apart() -> float:
        return float(torch.cdist(painter.strokes().color, colors).amin(1).max())

    assert apart() > 0.05
    painter.schedule.step = 20
    assert apart() == 0
    painter.schedule.step, painter.stop = 0, Status.INTERRUPTED
    assert apart() == 0, "a painting that was stopped early uses mixtures only"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Paint a small picture with tubes, and return the folder of the run."""
    folder = tmp_path_factory.mktemp("tubes")
    words = ["chelsea", "tubes=zorn", "mixtures=5", "brushes=[40,20]", "strokes=60", "steps=20", "resolution=64"]
    cfg = compose_config(
        expand_arguments([*words, *(f"{key}={value}".replace("False", "false") for key, value in QUIET.items())])
    )
    assert set(cfg.change) == {"tubes", "variety"}
    assert "ciede2000" in cfg.metric
    check(cfg, words)
    perform(paint, cfg, folder, time.monotonic())
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
    settings = settings_of("paint", {"image": "chelsea", "resolution": 48, "steps": 12, **options, **QUIET})
    painter = build_painter(settings.cfg)
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
    refuses(r"own\.csv: not text in UTF-8; save it with that encoding", load_tubes, str(path))


@pytest.mark.parametrize(("words", "message"), [
    ({"brushes": [0.5]}, "pixels wide; set resolution="),
    ({"brushes": []}, "leaves nothing to paint with"),
    ({"wet": 0.5}, "drop wet, or drop tubes"),
    ({"color": "pigment"}, "paint of tubes= is opaque"),
    ({"painter": "hertzmann"}, "is for painter=gradient"),
    ({"tubes": "eigth"}, "is neither a file nor a set"),
])  # fmt: skip
def test_what_no_table_has_is_refused_in_words(words, message):
    refuses(message, settings_of, "paint", {"image": "chelsea", "resolution": 64, "tubes": "zorn", **words})


def test_tubes_and_the_look_ask_for_each_other_unless_another_look_is_typed():
    chosen = [
        settings_of("paint", {"image": "chelsea", **words}).cfg for words in ({"look": "tubes"}, {"tubes": "zorn"})
    ]
    assert [cfg.change.tubes.tubes for cfg in chosen] == ["eight", "zorn"]
    for cfg in chosen:
        assert (cfg.steps, plugin_of(cfg.init).name) == (300, "layers")
        assert cfg.metric == chosen[0].metric
        assert "ciede2000" in cfg.metric
    oil = settings_of("paint", {"image": "chelsea", "tubes": "zorn", "look": "oil"}).cfg
    assert (oil.light.depth, oil.change.tubes.tubes, oil.change.variety.amount) == (0.9, "zorn", 0.55)
    assert "ciede2000" in oil.metric


def test_a_set_that_is_not_there_is_refused():
    refuses("tubes=zurn is neither a file nor a set; choose one of acrylics, eight, ", load_tubes, "zurn")
