"""Tests that painters run their stages until a goal ends them, and that steps on a part match steps on the whole."""

import itertools
from copy import deepcopy
from functools import partial
from types import SimpleNamespace

import lightning as L
import numpy as np
import pytest
import torch
from brushexp_policies.accuracy import Accuracy
from brushexp_policies.patches import Patches, places
from painters import SIZE as CANVAS
from painters import error_of, fit, gradient_of, take
from painters import painter_of as some_painter
from scenes import Windowed, random_strokes
from torch.testing import assert_close

from brushexp.compositing import bands
from brushexp.compositing.layers import SOFT_EDGE
from brushexp.painting import stroke_optimizer
from brushexp.painting.canvas_memory import PatchCache, find_reaching
from brushexp.painting.components import Stage
from brushexp.painting.goals import NoMoreGain, Quality, TimeBudget, goals_of
from brushexp.painting.schedule import Pair, Schedule, add_pair
from brushexp.painting.stroke_optimizer import StrokeOptimizer
from brushexp.pictures.region import Region
from brushexp.plugins.blend.tiled import Tiled
from brushexp.plugins.density.strays import Strays
from brushexp.plugins.loss.kl import KullbackLeibler
from brushexp.plugins.loss.mse import MeanSquaredError
from brushexp.plugins.loss.perceptual import Perceptual
from brushexp.plugins.optimizer.torch import TorchOptim
from brushexp.plugins.renderer.analytic import Analytic
from brushexp.plugins.renderer.textured import Textured
from brushexp.plugins.sampler.base import View
from brushexp.plugins.sampler.whole import Whole
from brushexp.registry import build_named
from brushexp.strokes.bezier import curve_of
from brushexp.strokes.prior import clamp_to_prior
from brushexp.system.callbacks import TimedCheckpoint
from brushexp.system.status import Status

SIZE = (24, 33)


def painter_of(*stages: Stage, n: int = 20) -> StrokeOptimizer:
    return some_painter(*stages, strokes=random_strokes(n, SIZE), size=SIZE, blend=Tiled())


def test_stages_follow_from_the_steps_and_what_a_run_leaves_is_drawn_by_the_last_renderer():
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
    painter = painter_of(Stage("analytic", Analytic(), 10), Stage("windowed", Windowed(), 0))
    take(painter, 3)
    before = curve_of(painter.strokes()).mean(1)
    painter.hand_over()
    assert isinstance(painter.renderer, Windowed)
    assert painter.schedule.step == painter.schedule.steps == 3
    assert (curve_of(painter.strokes()).mean(1) - before).norm(dim=1).mean() < 1


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


class Work:
    """A stand-in for a painter: it has a schedule but no picture, and each step takes ``cost(step)`` seconds."""

    def __init__(self, *steps: int, cost=lambda step: 0.1, error: float = 0.1) -> None:
        self.schedule = Schedule(steps)
        self.now, self.schedule.clock = 0.0, lambda: self.now
        self.cost, self.picture = cost, SimpleNamespace(error=error)
        self.evaluations, self.is_unready, self.stop = 0, False, None
        self.rates: list[float] = []

    def run(self, *goals: L.Callback, most: int = 10**5) -> "Work":
        """Take steps as a painter does, until the schedule, a goal or ``most`` ends them."""
        schedule = self.schedule
        schedule.start()
        for goal in goals:
            goal.on_fit_start(None, self)
        while schedule.step < min(schedule.steps, most) and not self.stop:
            done, steps = schedule.stage_progress
            self.rates.append(0.02 * TorchOptim().share(done / steps))
            self.now += self.cost(schedule.step)
            schedule.step += 1
            self.evaluations += 1
            for goal in goals:
                goal.on_train_batch_end(None, self)
        for goal in goals:
            goal.on_train_end(None, self)
        schedule.pause()
        return self


COSTS = {
    "steady": lambda step: 0.1,
    "dearer": lambda step: 0.02 + 0.001 * step,
    "cheaper": lambda step: max(0.02, 0.2 - 0.002 * step),
    "rounds": lambda step: 0.3 if step % 5 == 0 else 0.05,
    "jump": lambda step: 0.02 if step < 100 else 0.15,
}


@pytest.mark.parametrize("cost", COSTS)
@pytest.mark.parametrize("seconds", [0.9, 10.0, 30.0])
def test_the_steps_fit_the_seconds_and_the_rate_comes_down(cost, seconds):
    work = Work(500, cost=COSTS[cost]).run(TimeBudget(seconds))
    schedule = work.schedule
    assert work.stop == Status.SECONDS_SPENT
    assert schedule.step == schedule.steps
    assert schedule.seconds == pytest.approx(seconds, rel=0.02, abs=max(map(COSTS[cost], range(schedule.step))))
    if seconds > 5:
        assert work.rates[0] == pytest.approx(0.02)
        assert work.rates[-1] < 0.1 * 0.02
        assert all(a >= b - 0.15 * 0.02 for a, b in itertools.pairwise(work.rates)), "it never leaps up"


@pytest.mark.parametrize(("steps", "seconds", "taken"), [(3, 10.0, 100), (0, 10.0, 100), (100, 0.0, 0)])
def test_seconds_replace_steps(steps, seconds, taken):
    assert Work(steps).run(TimeBudget(seconds)).schedule.step == taken


def test_a_quality_ends_the_run_and_the_last_stage_gets_half_of_the_seconds(caplog):
    work = Work(60, 40, 10)
    work.cost = lambda step: (0.01, 0.02, 0.5)[work.schedule.stage]
    ends = work.run(TimeBudget(60.0)).schedule.ends
    assert [ends[0] * 0.01, (ends[1] - ends[0]) * 0.02] == pytest.approx([18, 12], abs=0.5)
    assert work.schedule.seconds == pytest.approx(60, abs=0.5)
    assert work.stop == Status.SECONDS_SPENT
    caplog.set_level("INFO")
    assert Work(40, error=0.1).run(Quality(10.5)).stop is None
    assert "psnr=10.5 was not reached; the picture has 10.00 dB" in caplog.text
    work = Work(40, error=0.1).run(Quality(9.5))
    assert (work.stop, work.schedule.step) == (Status.PSNR_REACHED, 1)
    assert "psnr=9.5 was reached after" in caplog.text
    assert Work(5, 5).run(Quality(0.0)).schedule.step == 6, "only the last stage reaches it"


def test_an_early_stop_goes_on_with_the_next_stage_counts_evaluations_and_remembers_them(tmp_path):
    painter = some_painter(Stage("a", Analytic(), 1000), Stage("b", Analytic(), 3))
    end = TimedCheckpoint(tmp_path / "it.ckpt", None)
    fit(painter, [NoMoreGain(50.0), end])
    assert (painter.stop, painter.schedule.ends) == (None, [200, 203]), "200 evaluations have gained nothing"
    lbfgs = {"optimizer": TorchOptim(name="LBFGS", lr=0.5, options={"max_iter": 4})}
    whole, first, second = (some_painter(**lbfgs) for _ in range(3))
    fit(whole, [NoMoreGain(50.0), end])
    assert (whole.stop, 200 <= whole.evaluations < 210) == (Status.STOPPED_EARLY, True)
    fit(first, [NoMoreGain(50.0)], max_steps=whole.schedule.step - 2).save_checkpoint(tmp_path / "it.ckpt")
    fit(second, [NoMoreGain(50.0)], ckpt_path=tmp_path / "it.ckpt")
    assert second.evaluations == whole.evaluations


def curve_through(*pairs: Pair, **options: int) -> list[Pair]:
    curve: list[Pair] = []
    for pair in pairs:
        add_pair(curve, *pair, **options)
    return curve


def test_a_curve_keeps_its_ends_and_bends_is_recorded_and_goals_end_the_fit():
    seconds = np.linspace(0, 60, 601)
    psnr = 30 - 15 * np.exp(-seconds / 5)
    curve = curve_through(*zip(seconds, psnr, strict=True), most=20)
    assert len(curve) == 20
    assert (curve[0], curve[-1]) == ((seconds[0], psnr[0]), (seconds[-1], psnr[-1]))
    assert sum(time < 15 for time, _ in curve) > 10, "more where it bends"
    assert np.interp(seconds, *zip(*curve, strict=True)) == pytest.approx(psnr, abs=0.15)
    inf, nan = float("inf"), float("nan")
    pairs = (0.0, 10.0), (0.0, 11.0), (1.0, inf), (1.0, 12.0), (2.0, nan), (2.0, -inf)
    assert curve_through(*pairs) == [(0.0, 11.0), (1.0, 12.0)]
    painter = some_painter(steps=10**6)
    trainer = fit(painter, goals_of(early_stop=None, psnr=0.0, seconds=60.0))
    assert (painter.stop, trainer.global_step) == (Status.PSNR_REACHED, 1)
    assert painter.anytime[0][0] == 0.0
    painter = some_painter(Stage("a", Analytic(), 100), Stage("b", Analytic(), 5))
    fit(painter, goals_of(early_stop=None, psnr=None, seconds=1.0))
    assert painter.stop == Status.SECONDS_SPENT
    assert painter.schedule.ends[0] > 1
    assert painter.schedule.steps > painter.schedule.ends[0]


def test_seconds_cpu_time_and_the_curve_go_on_after_an_interruption(tmp_path):
    spent, schedules = SimpleNamespace(cpu=50.0), (Schedule([3]), Schedule([3]))
    for schedule, total in zip(schedules, (2.0, 4.0), strict=True):
        schedule.cpu_clock = lambda: spent.cpu
        schedule.load_state_dict(schedules[0].state_dict())
        spent.cpu += 50
        schedule.start()
        spent.cpu += 2
        schedule.pause()
        spent.cpu += 50
        assert schedule.cpu_seconds == total
    first, second = some_painter(steps=10**6), some_painter(steps=10**6)
    for schedule in (first.schedule, second.schedule):
        schedule.clock = lambda schedule=schedule: 0.01 * schedule.step
    fit(first, [TimeBudget(0.5)], max_steps=20).save_checkpoint(tmp_path / "it.ckpt")
    assert first.stop is None
    fit(second, [TimeBudget(0.5)], ckpt_path=tmp_path / "it.ckpt")
    assert second.stop == Status.SECONDS_SPENT
    assert second.schedule.step == pytest.approx(50, abs=1)
    assert second.anytime[0] == first.anytime[0]
    assert second.anytime[-1][0] == pytest.approx(second.schedule.seconds)


RENDERERS = {"analytic": Analytic, "textured": Textured, "windowed": Windowed}


few = partial(Patches, n_active=15, n_ring=15, patch=32)


@pytest.mark.parametrize("coverage", ["fair", "random"])
@pytest.mark.parametrize("renderer", RENDERERS)
def test_a_patch_that_covers_the_canvas_paints_the_same_picture_as_the_whole(renderer, coverage):
    everything = Patches(n_active=10**6, n_ring=0, patch=10**6, coverage=coverage)
    whole, part = (some_painter(renderer=RENDERERS[renderer](), sampler=sampler) for sampler in (Whole(), everything))
    take(whole, 12)
    take(part, 12)
    assert_close(dict(whole.strokes().items()), dict(part.strokes().items()), rtol=1e-4, atol=1e-3)
    assert_close(whole.draw_whole(), part.draw_whole(), rtol=0, atol=1e-3)


@pytest.mark.parametrize("renderer", RENDERERS)
def test_with_all_others_in_the_ring_active_strokes_feel_what_they_feel_in_the_whole(renderer):
    painter = some_painter(renderer=RENDERERS[renderer]())
    active, ring = torch.arange(60).chunk(2)
    region = Region(0, 0, *CANVAS)
    whole = gradient_of(painter, View(region))
    total = painter.terms["mse"]
    part = gradient_of(painter, View(region, active, ring), painter.catalogue.part(active))
    assert_close(painter.terms["mse"], total, rtol=1e-3, atol=1e-6)  # cached windows have 16 bits
    for name, value in part.items():
        assert_close(value, whole[name][active], rtol=2e-3, atol=2e-3 * float(whole[name].abs().max()))


def test_only_active_strokes_move_and_their_past_is_remembered_from_visit_to_visit():
    painter = some_painter(sampler=few(n_active=7, patch=20))
    loop = take(painter, 0)
    for _ in range(8):
        before = [value.clone() for _, value in painter.strokes().items()]
        take(painter, 1, loop)
        pairs = zip(before, painter.strokes().items(), strict=True)
        moved = [(old != new).reshape(60, -1).any(1) for old, (_, new) in pairs]
        assert 0 < torch.stack(moved).any(0).sum() <= 7
    painter = some_painter(sampler=few(n_active=20, patch=70, steps_per_patch=2))
    optimizer = take(painter, 30)["optimizer"]
    for parameter in painter.catalogue.parameters():
        state = optimizer.state[parameter]
        assert state["exp_avg"].shape == parameter.shape
        assert (state["exp_avg_sq"].reshape(60, -1).sum(1) > 0).float().mean() > 0.6  # some lie outside the canvas
    assert painter.visits.min() >= 2


@pytest.mark.parametrize("soft", [2.0, 20.0])
def test_a_part_is_what_it_would_be_in_the_whole_however_soft_strokes_are(soft):
    painter = some_painter(renderer=Analytic(soft=soft), sampler=few(patch=24))
    strokes, whole = painter.strokes(), painter.draw_whole()
    for step in range(6):
        view = painter.components.sampler(strokes, CANVAS, step, painter.generator)
        painter.loss(view)
    assert_close(painter.picture.memory.picture, whole, atol=1e-5, rtol=0)


SEARCH = {"max_iter": 4, "line_search_fn": "strong_wolfe"}  # without it, it is luck whether partial steps help
OPTIMIZERS = {"SGD": {"lr": 3.0}, "RMSprop": {}, "LBFGS": {"lr": 1.0, "options": SEARCH}, "Adafactor": {"lr": 0.01}}
PARTS = {name: {"optimizer": TorchOptim(name=name, **options)} for name, options in OPTIMIZERS.items()}
FEATURES = {"perceptual": Perceptual(), "kl": KullbackLeibler(), "mse": MeanSquaredError()}
PARTS |= {"losses": {"losses": FEATURES, "order": Accuracy(every=1)}}


@pytest.mark.parametrize(("name", "coarse"), [*((name, 0.0) for name in PARTS), ("SGD", 0.2), ("losses", 0.2)])
def test_partial_steps_lower_the_error_with_any_optimiser_and_loss_also_after_coarse_ones(name, coarse):
    painter = some_painter(steps=40, sampler=few(), options={"coarse": coarse}, **PARTS[name])
    before = error_of(painter)
    fit(painter)
    assert (painter.schedule.step, painter.stop) == (40, None)
    assert error_of(painter) < before
    assert all(term.isfinite() for term in painter.terms.values())
    assert sorted(painter.depth.front_to_back.tolist()) == list(range(60))
    if name == "losses":
        assert (painter.depth.accuracy != 0).sum() > 40


class EveryOther(Patches):
    def __call__(self, strokes, size, step, generator):
        return View(Region(0, 0, *size)) if step % 2 else super().__call__(strokes, size, step, generator)


@pytest.mark.parametrize("sampler", [few, partial(EveryOther, n_active=15, patch=32)], ids=["parts", "every other"])
@pytest.mark.parametrize("renderer", RENDERERS)
def test_the_kept_picture_stays_near_the_truth_and_its_error_is_known(renderer, sampler):
    painter = some_painter(renderer=RENDERERS[renderer](), sampler=sampler(), optimizer=TorchOptim(lr=0.005))
    loop = take(painter, 36)
    for _ in range(4):
        take(painter, 1, loop)
        error = float((painter.latest() - painter.picture.target).square().mean())
        assert painter.picture.error == pytest.approx(error, rel=1e-5)
    assert float((painter.latest() - painter.draw_whole()).abs().mean()) < 0.01
    painter.picture.forget()
    assert painter.picture.error == pytest.approx(error, rel=1e-5), "known when another renderer takes over"


def test_fair_coverage_visits_every_stroke_equally_often():
    sampler, generator = Patches(n_active=25, n_ring=10, patch=40, steps_per_patch=3), torch.Generator().manual_seed(1)
    strokes, counts, step = random_strokes(200, CANVAS), torch.zeros(200, dtype=torch.long), 0
    strokes.position[:20] = 5e4  # far off the canvas
    for _ in range(4):
        rounds, seen = 0, counts.clone()
        while rounds == 0 or sampler._turn < int(sampler._round.max()):
            for _ in range(3):
                view = sampler(strokes, CANVAS, step, generator)
                counts[view.active] += 1
                step += 1
            rounds += 1
        assert (counts - seen == 3).all(), "once in each round, for three steps"


def test_random_coverage_takes_the_nearest_strokes_to_a_point_all_of_one_and_none():
    sampler, generator = Patches(n_active=12, n_ring=6, patch=1000, coverage="random"), torch.Generator()
    strokes = random_strokes(100, CANVAS)
    view = sampler(strokes, CANVAS, 0, generator.manual_seed(4))
    point = torch.rand(2, generator=generator.manual_seed(4)) * torch.tensor([70.0, 48.0])
    inside = strokes.position.clamp_min(0).minimum(torch.tensor([70.0, 48.0]))
    by_distance = (inside - point).norm(dim=1).argsort()
    assert set(view.active.tolist()) == set(by_distance[:12].tolist())
    assert set(view.ring.tolist()) == set(by_distance[12:18].tolist())
    again = sampler(strokes, CANVAS, 1, generator)
    assert torch.equal(again.active, view.active), "the same place for five steps"
    late = Patches(n_active=12, n_ring=6, patch=1000, coverage="random")  # as after coarse steps
    assert torch.equal(late(strokes, CANVAS, 3, generator.manual_seed(4)).active, view.active)
    view = Patches()(random_strokes(0, CANVAS), CANVAS, 0, torch.Generator())
    assert (view.region, view.active) == (Region(0, 0, *CANVAS), None)
    assert Patches().steps_per_round(random_strokes(0, CANVAS), CANVAS) == 1
    number = places(torch.zeros(100, 2), 7, 10.0, torch.Generator())
    assert number.bincount().max() <= 7
    assert (number.bincount() > 0).all()


@pytest.mark.parametrize("n", [1, 2, 33])
@pytest.mark.parametrize("options", [{}, {"n_ring": 0}, {"patch": 1}, {"patch": 5, "coverage": "random"}])
def test_odd_sizes_are_defined(n, options):
    painter = some_painter(sampler=Patches(**options), n=n)
    take(painter, 6)
    assert painter.draw_whole().isfinite().all()
    assert painter.visits.sum() > 0, "strokes are found, however few there are"


def test_kept_pictures_are_those_of_the_renderer_drawn_once_and_within_their_memory():
    strokes, renderer = clamp_to_prior(random_strokes(30, CANVAS)), Windowed()
    with torch.no_grad():
        expected = renderer(strokes).images
    renderer.drawn, generator = 0, torch.Generator().manual_seed(0)
    kept, number = PatchCache(renderer, most_bytes=8 * 2 * 4 * 16 * 16), torch.tensor([3, 17, 4, 29])  # eight windows
    for _ in range(3):
        kept.layers(strokes[number], number)
    assert renderer.drawn == 4
    kept.forget(torch.tensor([17, 5]))
    kept.layers(strokes[number], number)
    assert renderer.drawn == 4 + 1
    for size in [5, 8, 8, 13, 30, 2, 8] * 3:
        number = torch.randperm(30, generator=generator)[:size]
        assert_close(kept.layers(strokes[number], number).images, expected[number], rtol=0, atol=1e-3)
        assert len(kept._pictures) <= 8


@pytest.mark.parametrize("coverage", ["fair", "random"])
@pytest.mark.parametrize("patch", [12, 30, 500])
def test_a_round_is_as_many_steps_as_move_each_stroke_once(coverage, patch):
    sampler = Patches(n_active=20, n_ring=0, patch=patch, steps_per_patch=1, coverage=coverage)
    strokes = random_strokes(150, CANVAS)
    steps, generator = sampler.steps_per_round(strokes, CANVAS), torch.Generator().manual_seed(1)
    moved = sum(len(sampler(strokes, CANVAS, step, generator).active) for step in range(10 * steps))
    assert moved / (10 * 150) == pytest.approx(1, rel=0.3)


def test_losses_keep_their_balance_on_parts_and_touched_pixels_are_those_in_the_boxes():
    losses = {name: build_named("loss", name, {"weight": weight}) for name, weight in (("mse", 3.0), ("kl", 2.0))}
    painter = some_painter(losses=losses)
    active, ring = torch.arange(60).chunk(2)
    total = painter.loss(View(Region(7, 9, 24, 35), active, ring))
    assert float(total.detach()) == pytest.approx(3 / 4 * float(painter.terms["mse"]) + 2 * float(painter.terms["kl"]))
    strokes = random_strokes(12, CANVAS)
    region = Region(5, 9, 30, 41)
    result = find_reaching(strokes, region, SOFT_EDGE)
    no_paint = torch.tensor([9.0, 9.0, 9.0])
    painted = region.of((Tiled(opaque=0)(Analytic()(strokes), torch.arange(12), CANVAS, no_paint).image != 9).any(0))
    assert result.shape == (30, 41)
    assert (result | ~painted).all(), "no painted pixel is missed"
    assert result.float().mean() < 1
    assert not find_reaching(strokes[:0], region, SOFT_EDGE).any()
