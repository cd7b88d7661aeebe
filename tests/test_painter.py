"""The painter goes through its stages, and a large picture is drawn in bands."""

from types import SimpleNamespace

import numpy as np
import pytest
import torch
from scenes import Windowed, random_strokes

from brushexp.compositing import bands as bands_module
from brushexp.painting.components import Components, Stage
from brushexp.painting.goals import STOPPED_EARLY, EarlyStop
from brushexp.painting.outputs import work_of
from brushexp.painting.painter import Painter
from brushexp.plugins.blend.tiled import Tiled
from brushexp.plugins.density.fixed import Fixed
from brushexp.plugins.export.png import pixels
from brushexp.plugins.loss.pixel import MeanSquaredError
from brushexp.plugins.optimizer.torch_optim import TorchOptim
from brushexp.plugins.order.area import Area
from brushexp.plugins.renderer.analytic import Analytic
from brushexp.plugins.sampler.whole import Whole
from brushexp.strokes.bezier import curve_of
from brushexp.strokes.catalogue import Catalogue
from brushexp.strokes.prior import clamp_to_prior
from brushexp.strokes.storage import Saved

SIZE = (24, 33)


def painter_of(*stages: Stage, n: int = 20) -> Painter:
    parts = Components(
        stages=stages,
        blend=Tiled(),
        order=Area(),
        losses={"mse": MeanSquaredError()},
        density=Fixed(),
        sampler=Whole(),
        optimizer=TorchOptim(),
    )
    catalogue = Catalogue(random_strokes(n, SIZE), parts.optimizer.units)
    return Painter(catalogue, parts, torch.rand(3, *SIZE), torch.tensor([0.2, 0.5, 0.9]), seed=0)


def take(painter: Painter, optimizer: torch.optim.Optimizer, steps: int) -> list[float]:
    """Learning rates of these steps."""
    rates = []
    for _ in range(steps):
        painter._take_step(optimizer)
        rates.append(optimizer.param_groups[0]["lr"])
    return rates


def test_stages_follow_from_the_steps():
    analytic, windowed = Analytic(), Windowed()
    painter = painter_of(Stage("analytic", analytic, 4), Stage("windowed", windowed, 3))
    optimizer, seen = painter.configure_optimizers(), []
    painter.watch = lambda step: seen.append((step, painter.stage, painter.progress))
    assert painter.steps == 7
    assert painter.renderer is analytic
    first = take(painter, optimizer, 4)
    assert painter.renderer is windowed
    assert not optimizer.state, "the optimiser starts afresh"
    second = take(painter, optimizer, 3)
    assert seen == [(1, 0, (1, 4)), (2, 0, (2, 4)), (3, 0, (3, 4)), *[(4 + k, 1, (k, 3)) for k in range(4)]]
    assert first[0] == second[0] == pytest.approx(0.02)
    assert painter.renderer is windowed


def test_a_patch_renderer_never_sees_what_it_cannot_draw(caplog):
    caplog.set_level("INFO")
    painter = painter_of(Stage("analytic", Analytic(), 2), Stage("windowed", Windowed(), 5))
    optimizer = painter.configure_optimizers()
    take(painter, optimizer, 1)
    assert not caplog.records
    before = painter.catalogue()
    assert not torch.equal(clamp_to_prior(before).width, before.width), "the scene should have strokes to change"
    for _ in range(6):
        take(painter, optimizer, 1)
        strokes = painter.catalogue()
        for name, value in clamp_to_prior(strokes).items():
            torch.testing.assert_close(getattr(strokes, name), value, atol=1e-6, rtol=0)
    (line,) = [record.getMessage() for record in caplog.records]
    assert "step 2: from here windowed draws" in line
    assert 0 < int(line.split("; ")[1].split()[0]) <= 20


def test_a_run_without_a_warm_start_tells_what_it_changes(caplog):
    caplog.set_level("INFO")
    painter_of(Stage("windowed", Windowed(), 5))
    assert "strokes were changed to fit" in caplog.text


def test_a_stage_may_have_no_steps():
    painter = painter_of(Stage("analytic", Analytic(), 2), Stage("windowed", Windowed(), 0))
    take(painter, painter.configure_optimizers(), 2)
    assert isinstance(painter.renderer, Windowed)
    assert painter.step == painter.steps == 2


def test_an_early_stop_goes_on_with_the_next_stage():
    painter = painter_of(Stage("analytic", Analytic(), 1000), Stage("windowed", Windowed(), 3), n=2)
    optimizer, stop = painter.configure_optimizers(), EarlyStop(50.0)
    painter.watch = lambda step: stop.look(painter)
    take(painter, optimizer, 200)
    assert painter.stage == 1
    assert painter.steps == 203
    take(painter, optimizer, 3)
    assert painter.stop == ""


def test_an_early_stop_counts_evaluations_and_not_steps():
    painter = SimpleNamespace(stage=0, is_coarse=False, evaluations=0, error=0.1, stop="", end_stage=lambda: False)
    stop = EarlyStop(1.0)
    for _ in range(39):  # of 5 evaluations each
        painter.evaluations += 5
        stop.look(painter)
    assert painter.stop == ""
    painter.evaluations += 5
    stop.look(painter)
    assert painter.stop == STOPPED_EARLY


def test_what_a_run_leaves_is_drawn_by_the_last_renderer():
    painter = painter_of(Stage("analytic", Analytic(), 10), Stage("windowed", Windowed(), 5))
    take(painter, painter.configure_optimizers(), 3)
    before = curve_of(painter.catalogue()).mean(1)
    painter.end_all_but_last()
    assert isinstance(painter.renderer, Windowed)
    assert painter.step == 3
    assert (curve_of(painter.catalogue()).mean(1) - before).norm(dim=1).mean() < 1


@pytest.mark.parametrize("renderer", [Analytic(), Windowed()])
def test_bands_make_the_same_picture(renderer, monkeypatch):
    strokes = clamp_to_prior(random_strokes(60, SIZE))
    saved = Saved(strokes, torch.randperm(60).int(), SIZE, torch.rand(3), "", "", 0, "")
    whole = pixels(work_of(saved, renderer, Tiled(opaque=0), "", 330))
    monkeypatch.setattr(bands_module, "BAND", 330 * 16)
    bands = pixels(work_of(saved, renderer, Tiled(opaque=0), "", 330))
    assert whole.shape == (240, 330, 3)
    assert np.abs(whole.astype(int) - bands).max() <= 1


def test_bands_draw_only_the_strokes_that_touch_them(monkeypatch):
    strokes = clamp_to_prior(random_strokes(60, (1000, 33)))
    saved = Saved(strokes, torch.randperm(60).int(), (1000, 33), torch.rand(3), "", "", 0, "")
    renderer = Windowed()
    monkeypatch.setattr(bands_module, "BAND", 33 * 50)
    pixels(work_of(saved, renderer, Tiled(), ""))
    assert renderer.drawn < 2 * 60


def test_bands_get_lower_where_strokes_are_many(monkeypatch):
    strokes = clamp_to_prior(random_strokes(60, (1000, 33)))
    saved = Saved(strokes, torch.randperm(60).int(), (1000, 33), torch.rand(3), "", "", 0, "")
    held = []

    class Few(Windowed):
        at_once = 10

        def forward(self, strokes, number=None):
            held.append(len(strokes))
            return super().forward(strokes, number)

    picture = pixels(work_of(saved, Few(), Tiled(), ""))
    assert max(held) <= 10
    monkeypatch.setattr(Few, "at_once", None)
    assert np.abs(picture - pixels(work_of(saved, Few(), Tiled(), "")).astype(int)).max() <= 1
    assert held[-1] > 10


def test_a_line_search_may_look_anywhere():
    painter, seen = painter_of(Stage("analytic", Analytic(), 4)), []

    class Wild(torch.optim.SGD):
        def step(self, closure=None):
            for huge in (1e30, -1e38, float("inf"), float("nan")):
                for group in self.param_groups:
                    for parameter in group["params"]:
                        parameter.data.fill_(huge)
                seen.append(closure())

    painter._take_step(Wild([p for p in painter.catalogue.parameters() if p.requires_grad], lr=1.0))
    assert torch.stack(seen).isfinite().all()
    assert painter.picture().isfinite().all()
