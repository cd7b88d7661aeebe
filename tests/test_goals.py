"""A run ends when its goal is reached: time spent, quality reached, nothing gained."""

import itertools
import json
import signal
import time
from pathlib import Path
from types import SimpleNamespace

import pytest
import torch
from program import Program, run
from test_painter import painter_of, take
from torch.testing import assert_close

from brushexp.app.composition import check
from brushexp.errors import UserError
from brushexp.painting.anytime import Anytime
from brushexp.painting.components import Stage
from brushexp.painting.cost import Cost
from brushexp.painting.goals import INTERRUPTED, PSNR_REACHED, SECONDS_SPENT, STOPPED_EARLY, Budget, EarlyStop, Goals
from brushexp.painting.metrics import psnr_of
from brushexp.painting.painter import Painter
from brushexp.plugins.optimizer.torch_optim import TorchOptim
from brushexp.plugins.renderer.analytic import Analytic

SMALL = ["image=chelsea", "resolution=48", "threads=1", "frames=0"]


class Work:
    """A painting without a picture, whose steps take as long as they are said to: ``cost(step)`` seconds."""

    steps, stage, progress = Painter.steps, Painter.stage, Painter.progress
    elapsed, end_stage = Painter.elapsed, Painter.end_stage

    def __init__(self, *steps: int, cost=lambda step: 0.1, seconds: float = 0.0, error: float = 0.1) -> None:
        self.ends = list(itertools.accumulate(steps))
        self.seconds, self.error, self.cost = seconds, error, cost
        self.step = self.evaluations = 0
        self.is_coarse = False
        self.now, self.clock, self._looked, self.stop = 0.0, lambda: self.now, 0.0, ""
        self.rates: list[float] = []

    def run(self, goals: Goals, most: int = 10**5) -> "Work":
        """Take steps as a painter would."""
        for goal in goals.goals.values():
            goal.begin(self)
        while self.step < min(self.steps, most) and not self.stop:
            done, steps = self.progress
            self.rates.append(TorchOptim().rate(done / steps))
            self.now += self.cost(self.step)
            self.step += 1
            self.evaluations += 1
            goals.look(self)
        for goal in goals.goals.values():
            goal.end(self)
        self.seconds, self._looked = self.elapsed, None
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
@pytest.mark.parametrize("expected", [0.01, 0.1, 1.0])
def test_the_steps_fit_the_seconds_and_the_rate_comes_down(cost, seconds, expected):
    work = Work(500, cost=COSTS[cost])
    painter = work.run(Goals(seconds=seconds, costs=[Cost(expected)]))
    assert painter.stop == SECONDS_SPENT
    assert painter.step == painter.steps
    assert painter.seconds == pytest.approx(seconds, rel=0.02, abs=max(map(COSTS[cost], range(painter.step))))
    if seconds > 5:
        assert work.rates[0] == pytest.approx(0.02)
        assert work.rates[-1] < 0.1 * 0.02
        assert all(a >= b - 0.15 * 0.02 for a, b in itertools.pairwise(work.rates)), "it never leaps up"


def test_seconds_replace_steps():
    assert Work(3).run(Goals(seconds=10.0, costs=[Cost(0.1)])).step == 100
    assert Work(0).run(Goals(seconds=10.0, costs=[Cost(0.1)])).step == 100
    assert Work(100).run(Goals(seconds=0.0, costs=[Cost(0.1)])).step == 0


@pytest.mark.parametrize(("seconds", "last"), [(60.0, 40), (60.0, 10), (20.0, 40), (1.0, 40)])
def test_the_last_stage_keeps_its_steps_if_they_fit_into_half_of_the_seconds(seconds, last):
    work = Work(100, last)
    work.cost = lambda step: 0.01 if work.stage == 0 else 0.5
    painter = work.run(Goals(seconds=seconds, costs=[Cost(0.01), Cost(0.5)]))
    finish = painter.ends[1] - painter.ends[0]
    assert finish == pytest.approx(min(last, 0.5 * seconds / 0.5), abs=1)
    assert painter.seconds == pytest.approx(seconds, abs=0.5)
    assert painter.stop == SECONDS_SPENT


def test_what_a_stage_costs_before_its_first_step_is_left_for_it():
    work = Work(100, 40)
    work.cost = lambda step: 0.01 if step < work.ends[0] else 5.0 if step == work.ends[0] else 0.25
    painter = work.run(Goals(seconds=60.0, costs=[Cost(0.01), Cost(0.25, begin=5.0)]))
    assert painter.ends[1] - painter.ends[0] == pytest.approx(40, abs=1)
    assert painter.seconds == pytest.approx(60, abs=0.5)


def test_stages_before_the_last_share_as_they_would_have():
    budget = Budget(100.0, [Cost(0.1), Cost(0.2), Cost(1.0)])
    assert budget._divided([100, 100, 10]) == pytest.approx([30, 90, 100])


def test_time_before_an_interruption_counts():
    goals, first = Goals(seconds=20.0, costs=[Cost(0.1)]), Work(500)
    first.run(goals, most=50)
    assert first.stop == ""
    again, second = Goals(seconds=20.0, costs=[Cost(9.0)]), Work(500, seconds=first.seconds)
    again.load_state_dict(goals.state_dict())
    second.step, second.ends = first.step, first.ends
    painter = second.run(again)
    assert painter.step == pytest.approx(200, abs=1)
    assert painter.seconds == pytest.approx(20, abs=0.1)


def test_an_endless_time_is_refused():
    with pytest.raises(UserError, match="set seconds to a number"):
        Budget(float("inf"), [])


@pytest.mark.parametrize("override", ["seconds=-1", "psnr=-3"])
def test_goals_that_are_none_are_refused(config, override):
    with pytest.raises(UserError, match=override.partition("=")[0]):
        check(config(override))


def test_a_quality_ends_the_run(caplog):
    caplog.set_level("INFO")
    assert Work(40, error=0.1).run(Goals(psnr=10.5)).stop == ""
    assert "psnr=10.5 was not reached: the picture has 10.00 dB" in caplog.text
    work = Work(40, error=0.1).run(Goals(psnr=9.5))
    assert work.stop == PSNR_REACHED
    assert work.step == 1
    assert "psnr=9.5 is reached after" in caplog.text


def test_only_the_last_stage_reaches_a_quality():
    work = Work(5, 5).run(Goals(psnr=0.0))
    assert work.stop == PSNR_REACHED
    assert work.step == 6


def test_the_first_goal_ends_the_run():
    assert Work(400).run(Goals(psnr=0.0, seconds=20.0, costs=[Cost(0.1)])).stop == PSNR_REACHED
    assert Work(400).run(Goals(psnr=90.0, seconds=2.0, costs=[Cost(0.1)])).stop == SECONDS_SPENT
    assert Work(400).run(Goals(early_stop=50.0, seconds=200.0, costs=[Cost(0.1)])).stop == STOPPED_EARLY
    painter = Work(5).run(Goals(psnr=90.0, early_stop=0.0))
    assert painter.stop == ""
    assert painter.step == 5


def test_an_early_stop_leaves_the_next_stage_its_share_of_the_seconds():
    work = Work(100, 10)
    painter = work.run(Goals(early_stop=50.0, seconds=100.0, costs=[Cost(0.1), Cost(0.1)]))
    assert painter.ends[0] == 200, "200 evaluations have gained nothing"
    assert painter.stop == STOPPED_EARLY


def test_an_early_stop_remembers():
    stop = EarlyStop(1.0)
    painter = SimpleNamespace(stage=0, is_coarse=False, evaluations=150, error=0.1, stop="", end_stage=lambda: False)
    stop.look(painter)
    other = EarlyStop(1.0)
    other.load_state_dict(stop.state_dict())
    painter.evaluations = 250
    other.look(painter)
    assert painter.stop == STOPPED_EARLY


def test_a_curve_keeps_its_ends_and_its_bends():
    curve = Anytime(most=20)
    seconds = torch.linspace(0, 60, 601).tolist()
    psnr = [30 - 15 * 2.718 ** (-x / 5) for x in seconds]
    for pair in zip(seconds, psnr, strict=True):
        curve.add(*pair)
    assert len(curve.pairs) == 20
    assert curve.pairs[0] == (seconds[0], psnr[0])
    assert curve.pairs[-1] == (seconds[-1], psnr[-1])
    times = [pair[0] for pair in curve.pairs]
    assert times == sorted(times)
    assert sum(time < 15 for time in times) > 10, "more where it bends"
    between = [
        a[1] + (x - a[0]) / (b[0] - a[0]) * (b[1] - a[1])
        for x in seconds
        for a, b in itertools.pairwise(curve.pairs)
        if a[0] <= x <= b[0] and (x < b[0] or x == 60)
    ]
    assert_close(torch.tensor(between), torch.tensor(psnr), atol=0.15, rtol=0)


def test_a_curve_has_one_pair_for_each_time_and_only_numbers():
    curve = Anytime()
    for pair in [(0.0, 10.0), (0.0, 11.0), (1.0, float("inf")), (1.0, 12.0), (2.0, float("nan")), (2.0, -float("inf"))]:
        curve.add(*pair)
    assert curve.pairs == [(0.0, 11.0), (1.0, 12.0)]


def test_a_painter_records_its_curve_from_the_start():
    painter = painter_of(Stage("s", Analytic(), 30))
    first = float((painter.picture() - painter.target).square().mean())
    painter.rehearse()
    painter.on_fit_start()
    assert painter.anytime.pairs == [(0.0, pytest.approx(psnr_of(first), rel=1e-5))]
    take(painter, painter.configure_optimizers(), 3)
    checkpoint = {"state_dict": {}}
    painter.on_save_checkpoint(checkpoint)
    other = painter_of(Stage("s", Analytic(), 30))
    other.on_load_checkpoint(checkpoint)
    other.rehearse()
    other.on_fit_start()
    assert other.anytime.pairs == painter.anytime.pairs


def metrics_of(folder: Path) -> dict:
    return json.loads((folder / "metrics.json").read_text())


def test_a_run_tells_which_goal_ended_it(tmp_path):
    result = run(*SMALL, "psnr=5", f"output={tmp_path}/a", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    metrics = metrics_of(tmp_path / "a")
    assert metrics["status"] == PSNR_REACHED
    assert metrics["steps"] == 1
    assert metrics["predicted_seconds"] is None
    assert metrics["anytime"][0][0] == 0
    assert metrics["anytime"][-1] == [round(metrics["seconds"], 3), round(metrics["psnr"], 3)]
    assert "psnr=5 is reached after" in (tmp_path / "a" / "run.log").read_text()


def test_seconds_go_on_after_an_interruption(tmp_path):
    process = Program(*SMALL, "seconds=4", "checkpoint_every=0", f"output={tmp_path}/a", cwd=tmp_path)
    while not (tmp_path / "a" / "checkpoint.ckpt").exists() and process.poll() is None:
        time.sleep(0.05)
    process.send_signal(signal.SIGINT)
    _, err = process.communicate()
    assert process.returncode == 130, err
    first = metrics_of(tmp_path / "a")
    assert first["status"] == INTERRUPTED
    resumed = run(f"resume={tmp_path}/a", f"output={tmp_path}/b", cwd=tmp_path)
    assert resumed.returncode == 0, resumed.stderr
    second = metrics_of(tmp_path / "b")
    assert second["status"] == SECONDS_SPENT
    assert second["steps"] > first["steps"]
    assert second["anytime"][0] == first["anytime"][0]
