"""The painter goes through its stages, and a large picture is drawn in bands."""

from copy import deepcopy

import pytest
import torch
from brushexp_policies.patches import Patches
from brushexp_policies.strays import Strays
from painters import error_of, take
from painters import painter_of as some_painter
from scenes import Windowed, random_strokes
from torch.testing import assert_close

from brushexp.compositing import bands
from brushexp.painting import stroke_optimizer
from brushexp.painting.components import Stage
from brushexp.painting.stroke_optimizer import StrokeOptimizer
from brushexp.plugins.blend.tiled import Tiled
from brushexp.plugins.loss.kl import KullbackLeibler
from brushexp.plugins.renderer.analytic import Analytic
from brushexp.strokes.bezier import curve_of
from brushexp.strokes.prior import clamp_to_prior

SIZE = (24, 33)


def painter_of(*stages: Stage, n: int = 20) -> StrokeOptimizer:
    return some_painter(*stages, strokes=random_strokes(n, SIZE), size=SIZE, blend=Tiled())


def test_stages_follow_from_the_steps():
    analytic, windowed = Analytic(), Windowed()
    painter = painter_of(Stage("analytic", analytic, 4), Stage("windowed", windowed, 3))
    assert painter.schedule.steps == 7
    assert painter.renderer is analytic
    loop = take(painter, 4)
    assert (painter.schedule.stage, painter.schedule.stage_progress, painter.progress) == (1, (0, 3), 0)
    assert loop["optimizer"].param_groups[0]["lr"] == pytest.approx(0.02), "the schedule starts again"
    take(painter, 1, loop)
    assert painter.renderer is windowed
    assert (painter.visits == 1).all(), "and so does the optimiser"
    take(painter, 2, loop)
    assert (painter.schedule.stage, painter.schedule.step, painter.progress) == (1, 7, 1)


def test_a_patch_renderer_never_sees_what_it_cannot_draw(caplog):
    caplog.set_level("INFO")
    painter = painter_of(Stage("analytic", Analytic(), 2), Stage("windowed", Windowed(), 5))
    loop = take(painter, 2)
    assert not caplog.records
    before = painter.strokes()
    assert not torch.equal(clamp_to_prior(before).width, before.width), "the scene should have strokes to change"
    for _ in range(5):
        take(painter, 1, loop)
        strokes = painter.strokes()
        for name, value in clamp_to_prior(strokes).items():
            torch.testing.assert_close(getattr(strokes, name), value, atol=1e-6, rtol=0)
    (line,) = [record.getMessage() for record in caplog.records]
    assert "step 2: switching to renderer windowed" in line
    assert 0 < int(line.split("; ")[1].split()[0]) <= 20
    painter_of(Stage("windowed", Windowed(), 5))
    assert "step 0: switching" in caplog.text, "without a warm-up, too"


def test_what_a_run_leaves_is_drawn_by_the_last_renderer():
    painter = painter_of(Stage("analytic", Analytic(), 10), Stage("windowed", Windowed(), 0))
    take(painter, 3)
    before = curve_of(painter.strokes()).mean(1)
    painter.hand_over()
    assert isinstance(painter.renderer, Windowed)
    assert painter.schedule.step == painter.schedule.steps == 3
    assert (curve_of(painter.strokes()).mean(1) - before).norm(dim=1).mean() < 1


def test_bands_draw_only_the_strokes_that_touch_them_and_get_lower_where_those_are_many(monkeypatch):
    class Few(Windowed):
        at_once = 10

        def forward(self, strokes):
            held.append(len(strokes))
            return super().forward(strokes)

    size, held = (1000, 33), []
    painter = some_painter(strokes=clamp_to_prior(random_strokes(60, size)), size=size, renderer=Few())
    picture = painter.draw_whole()
    assert max(held) <= 10
    monkeypatch.setattr(Few, "at_once", None)
    torch.testing.assert_close(picture, painter.draw_whole(), atol=1 / 255, rtol=0)
    assert held[-1] > 10
    monkeypatch.setattr(bands, "BAND", 33 * 50)
    held.clear()
    painter.draw_whole()
    assert sum(held) < 2 * 60


def test_to_prepare_leaves_nothing_but_the_error_of_the_picture(monkeypatch):
    counts, real = [], stroke_optimizer.importance
    monkeypatch.setattr(stroke_optimizer, "importance", lambda one, *rest: counts.append(len(one)) or real(one, *rest))
    painter = some_painter(density=Strays(), sampler=Patches(coverage="random"), losses={"kl": KullbackLeibler()})
    before = deepcopy(painter.state())
    painter.prepare()
    assert counts == [1]
    assert_close(painter.state(), before, rtol=0, atol=0)
    assert all(parameter.grad is None for parameter in painter.parameters())
    assert painter.picture.error == pytest.approx(error_of(painter))


def test_a_line_search_may_look_anywhere():
    painter, seen = painter_of(Stage("analytic", Analytic(), 4)), []

    class Wild(torch.optim.SGD):
        def step(self, closure=None):
            for huge in (1e30, -1e38, float("inf"), float("nan")):
                for group in self.param_groups:
                    for parameter in group["params"]:
                        parameter.data.fill_(huge)
                seen.append(closure())

    painter.components.optimizer.kind = Wild
    painter.components.optimizer.options = {}
    take(painter, 1)
    assert torch.stack(seen).isfinite().all()
    assert painter.draw_whole().isfinite().all()
