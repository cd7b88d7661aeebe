"""A run ends when its goal is reached: time spent, quality reached, nothing gained."""

import itertools
from types import SimpleNamespace

import lightning as L
import numpy as np
import pytest
from painters import fit, painter_of

from brushexp.painting.components import Stage
from brushexp.painting.goals import PSNR_REACHED, SECONDS_SPENT, NoMoreGain, Quality, TimeBudget, goals_of
from brushexp.painting.schedule import Pair, Schedule, add_pair
from brushexp.plugins.optimizer.torch import TorchOptim
from brushexp.plugins.renderer.analytic import Analytic
from brushexp.system.callbacks import STOPPED_EARLY, TimedCheckpoint


class Work:
    """A painting without a picture, whose steps take as long as they are said to: ``cost(step)`` seconds."""

    def __init__(self, *steps: int, cost=lambda step: 0.1, error: float = 0.1) -> None:
        self.schedule = Schedule(steps)
        self.now, self.schedule.clock = 0.0, lambda: self.now
        self.cost, self.picture = cost, SimpleNamespace(error=error)
        self.evaluations, self.is_unready, self.stop = 0, False, ""
        self.rates: list[float] = []

    def run(self, *goals: L.Callback, most: int = 10**5) -> "Work":
        """Take steps as a painter would."""
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
    assert work.stop == SECONDS_SPENT
    assert schedule.step == schedule.steps
    assert schedule.seconds == pytest.approx(seconds, rel=0.02, abs=max(map(COSTS[cost], range(schedule.step))))
    if seconds > 5:
        assert work.rates[0] == pytest.approx(0.02)
        assert work.rates[-1] < 0.1 * 0.02
        assert all(a >= b - 0.15 * 0.02 for a, b in itertools.pairwise(work.rates)), "it never leaps up"


@pytest.mark.parametrize(("steps", "seconds", "taken"), [(3, 10.0, 100), (0, 10.0, 100), (100, 0.0, 0)])
def test_seconds_replace_steps(steps, seconds, taken):
    assert Work(steps).run(TimeBudget(seconds)).schedule.step == taken


def test_the_last_stage_gets_half_of_the_seconds():
    work = Work(60, 40, 10)
    work.cost = lambda step: (0.01, 0.02, 0.5)[work.schedule.stage]
    ends = work.run(TimeBudget(60.0)).schedule.ends
    assert [ends[0] * 0.01, (ends[1] - ends[0]) * 0.02] == pytest.approx([18, 12], abs=0.5)
    assert work.schedule.seconds == pytest.approx(60, abs=0.5)
    assert work.stop == SECONDS_SPENT


def test_a_quality_ends_the_run(caplog):
    caplog.set_level("INFO")
    assert Work(40, error=0.1).run(Quality(10.5)).stop == ""
    assert "psnr=10.5 was not reached: the picture has 10.00 dB" in caplog.text
    work = Work(40, error=0.1).run(Quality(9.5))
    assert work.stop == PSNR_REACHED
    assert work.schedule.step == 1
    assert "psnr=9.5 is reached after" in caplog.text
    assert Work(5, 5).run(Quality(0.0)).schedule.step == 6, "only the last stage reaches it"


def test_an_early_stop_goes_on_with_the_next_stage_counts_evaluations_and_remembers_them(tmp_path):
    painter = painter_of(Stage("a", Analytic(), 1000), Stage("b", Analytic(), 3))
    end = TimedCheckpoint(tmp_path / "it.ckpt", None)
    fit(painter, [NoMoreGain(50.0), end])
    assert (painter.stop, painter.schedule.ends) == ("", [200, 203]), "200 evaluations have gained nothing"
    lbfgs = {"optimizer": TorchOptim(name="LBFGS", lr=0.5, options={"max_iter": 4})}
    whole, first, second = (painter_of(**lbfgs) for _ in range(3))
    fit(whole, [NoMoreGain(50.0), end])
    assert (whole.stop, 200 <= whole.evaluations < 210) == (STOPPED_EARLY, True)
    fit(first, [NoMoreGain(50.0)], max_steps=whole.schedule.step - 2).save_checkpoint(tmp_path / "it.ckpt")
    fit(second, [NoMoreGain(50.0)], ckpt_path=tmp_path / "it.ckpt")
    assert second.evaluations == whole.evaluations


def curve_of(*pairs: Pair, **options: int) -> list[Pair]:
    curve: list[Pair] = []
    for pair in pairs:
        add_pair(curve, *pair, **options)
    return curve


def test_a_curve_keeps_its_ends_and_its_bends_one_pair_for_each_time_and_only_numbers():
    seconds = np.linspace(0, 60, 601)
    psnr = 30 - 15 * np.exp(-seconds / 5)
    curve = curve_of(*zip(seconds, psnr, strict=True), most=20)
    assert len(curve) == 20
    assert (curve[0], curve[-1]) == ((seconds[0], psnr[0]), (seconds[-1], psnr[-1]))
    assert sum(time < 15 for time, _ in curve) > 10, "more where it bends"
    assert np.interp(seconds, *zip(*curve, strict=True)) == pytest.approx(psnr, abs=0.15)
    inf, nan = float("inf"), float("nan")
    pairs = (0.0, 10.0), (0.0, 11.0), (1.0, inf), (1.0, 12.0), (2.0, nan), (2.0, -inf)
    assert curve_of(*pairs) == [(0.0, 11.0), (1.0, 12.0)]


def test_a_painter_records_its_curve_and_goals_end_its_fit():
    painter = painter_of(steps=10**6)
    trainer = fit(painter, goals_of(early_stop=None, psnr=0.0, seconds=60.0))
    assert (painter.stop, trainer.global_step) == (PSNR_REACHED, 1)
    assert painter.anytime[0][0] == 0.0
    painter = painter_of(Stage("a", Analytic(), 100), Stage("b", Analytic(), 5))
    fit(painter, goals_of(early_stop=None, psnr=None, seconds=1.0))
    assert painter.stop == SECONDS_SPENT
    assert painter.schedule.ends[0] > 1
    assert painter.schedule.steps > painter.schedule.ends[0]


def test_cpu_seconds_are_those_of_fits_and_go_on_in_another_process():
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


def test_seconds_and_the_curve_go_on_after_an_interruption(tmp_path):
    first, second = painter_of(steps=10**6), painter_of(steps=10**6)
    for schedule in (first.schedule, second.schedule):
        schedule.clock = lambda schedule=schedule: 0.01 * schedule.step
    fit(first, [TimeBudget(0.5)], max_steps=20).save_checkpoint(tmp_path / "it.ckpt")
    assert first.stop == ""
    fit(second, [TimeBudget(0.5)], ckpt_path=tmp_path / "it.ckpt")
    assert second.stop == SECONDS_SPENT
    assert second.schedule.step == pytest.approx(50, abs=1)
    assert second.anytime[0] == first.anytime[0]
    assert second.anytime[-1][0] == pytest.approx(second.schedule.seconds)
