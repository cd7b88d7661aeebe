"""What a run will take is predicted from a few steps on a copy of it."""

from dataclasses import replace

import pytest
import torch
from scenes import Windowed, random_strokes
from test_painter import SIZE

from brushexp.painting.components import Components, Stage
from brushexp.painting.cost import GROWTH, Cost, Line, calibrate, in_words, predict
from brushexp.painting.painter import Painter
from brushexp.plugins.blend.tiled import Tiled
from brushexp.plugins.density.fixed import Fixed
from brushexp.plugins.loss.pixel import MeanSquaredError
from brushexp.plugins.optimizer.torch_optim import TorchOptim
from brushexp.plugins.order.area import Area
from brushexp.plugins.renderer.analytic import Analytic
from brushexp.plugins.renderer.base import Renderer
from brushexp.plugins.sampler.patches import Patches
from brushexp.plugins.sampler.whole import Whole
from brushexp.strokes.catalogue import Catalogue


class Watch:
    """A clock that work moves on."""

    def __init__(self) -> None:
        self.now = self.drawn = 0.0

    def __call__(self) -> float:
        return self.now


class Costly(Renderer):
    """Takes so many seconds for a picture, and for each stroke in it."""

    def __init__(self, watch: Watch, fixed: float, each: float) -> None:
        super().__init__()
        self.watch, self.fixed, self.each, self.brush = watch, fixed, each, Analytic()

    def forward(self, strokes, number=None):
        self.watch.now += self.fixed + self.each * len(strokes)
        self.watch.drawn = max(self.watch.drawn, len(strokes))
        return self.brush(strokes, number)


def painter_of(watch: Watch, *stages: Stage, n: int = 200, sampler=None, density=None) -> Painter:
    parts = Components(
        stages=stages,
        blend=Tiled(),
        order=Area(),
        losses={"mse": MeanSquaredError()},
        density=density or Fixed(),
        sampler=sampler or Whole(),
        optimizer=TorchOptim(),
    )
    torch.manual_seed(5)
    painter = Painter(
        Catalogue(random_strokes(n, SIZE), parts.optimizer.units), parts, torch.rand(3, *SIZE), torch.rand(3), seed=0
    )
    painter.clock = watch
    painter.rehearse()
    return painter


@pytest.mark.parametrize(("fixed", "each"), [(0.01, 0.0001), (0.1, 0.0), (0.0, 0.001), (0.05, 0.05)])
def test_the_prediction_is_what_the_steps_take(fixed, each):
    watch = Watch()
    painter = painter_of(watch, Stage("costly", Costly(watch, fixed, each), 1000))
    assert predict(painter) == pytest.approx(GROWTH * 1000 * (fixed + 200 * each), rel=0.01)


@pytest.mark.parametrize(("fixed", "each"), [(0.01, 0.0001), (0.0, 0.1), (0.05, 0.05), (2.0, 0.1)])
def test_a_slow_stage_is_predicted_from_a_part_of_the_strokes(fixed, each):
    watch = Watch()
    stages = Stage("analytic", Costly(watch, 0.02, 0.0), 100), Stage("slow", Costly(watch, fixed, each), 40)
    painter = painter_of(watch, *stages)
    before = watch.now
    first, last = calibrate(painter)
    assert first.step == pytest.approx(GROWTH * 0.02, rel=0.01)
    assert last.seconds(40) == pytest.approx(40 * (fixed + 200 * each), rel=0.3)
    assert watch.now - before < 4 + 4 * fixed + 12 * each, "nor does it take long"


def test_strokes_that_will_come_are_counted():
    watch = Watch()
    density = Fixed()
    density.mean_share = 3.0
    painter = painter_of(watch, Stage("costly", Costly(watch, 0.01, 0.0001), 1000), density=density)
    painter.budget = 600
    assert predict(painter) == pytest.approx(GROWTH * 1000 * (0.01 + 600 * 0.0001), rel=0.01)


def test_short_runs_are_not_predicted():
    watch = Watch()
    painter = painter_of(watch, Stage("costly", Costly(watch, 0.01, 0.0), 999))
    before = watch.now
    assert predict(painter) is None
    assert watch.now - before == pytest.approx(0.01), "a step was enough to see it"
    assert predict(painter, long=1) == pytest.approx(GROWTH * 9.99)
    shared = Costly(watch, 0.02, 0.0)
    assert predict(painter_of(watch, Stage("a", shared, 5), Stage("b", shared, 5))) is None
    assert predict(painter_of(watch, Stage("a", shared, 5), Stage("b", Costly(watch, 0.02, 0.0), 5))) is None


def test_partial_updates_are_predicted_from_whole_places():
    watch = Watch()
    stages = Stage("costly", Costly(watch, 0.01, 0.001), 100), Stage("other", Costly(watch, 0.02, 0.001), 100)
    painter = painter_of(watch, *stages, sampler=Patches(n_active=20, n_ring=10))
    first, last = calibrate(painter)
    assert first.begin == 0
    assert 0.01 < first.step < 0.01 * 2 + 0.001 * 31
    assert 0.02 < last.step < 0.02 * 2 + 0.001 * 31
    assert last.begin == pytest.approx(0.02 + 0.2, rel=0.05), "the whole picture, once"
    watch.drawn = 0
    painter_of(watch, Stage("windowed", Windowed(), 10), sampler=Patches(n_active=20, n_ring=10)).trial(0)
    assert watch.drawn == 0


@pytest.mark.parametrize("sampler", [Whole, Patches])
def test_a_trial_leaves_the_painting_as_it_is(sampler):
    def painted(*, tried: bool) -> Painter:
        watch = Watch()
        stages = Stage("a", Costly(watch, 1.0, 0.1), 5), Stage("b", Costly(watch, 0.5, 0.1), 3)
        painter = painter_of(watch, *stages, n=40, sampler=sampler())
        if tried:
            state = torch.get_rng_state()
            calibrate(painter)
            assert torch.equal(torch.get_rng_state(), state)
        assert painter.step == painter.evaluations == 0
        assert painter.ends == [5, 8]
        painter.advance(painter.configure_optimizers(), 1000)
        return painter

    one, other = painted(tried=False), painted(tried=True)
    for name, value in one.catalogue().items():
        assert torch.equal(value, getattr(other.catalogue(), name)), name
    assert torch.equal(one.picture(), other.picture())
    assert torch.equal(one.generator.get_state(), other.generator.get_state())


def test_a_trial_shares_what_is_large():
    painter = painter_of(Watch(), Stage("a", Analytic(), 5), Stage("b", Windowed(), 3))
    trial = painter.trial(1, 0.25)
    assert trial.stage == 1
    assert len(trial.catalogue) == 50
    assert trial.target is painter.target
    assert trial.renderer is painter.parts.stages[1].renderer
    assert trial.parts.density is not painter.parts.density
    assert trial.generator is not painter.generator


def test_an_empty_painting_can_be_tried():
    watch = Watch()
    painter = painter_of(watch, Stage("costly", Costly(watch, 0.01, 0.0001), 2000), n=0)
    assert predict(painter) == pytest.approx(GROWTH * 20.0, rel=0.01)


def test_a_line_never_falls_nor_begins_below_nothing():
    assert Line.through([(10, 1.0)]) == Line(0.0, 0.1)
    assert Line.through([(10, 3.0), (20, 2.0)])(40) == pytest.approx(2.0)
    assert Line.through([(10, 0.5), (20, 2.0)])(40) == pytest.approx(4.0)
    assert Line.through([(1, 9.0), (10, 2.0), (20, 3.0)])(40) == pytest.approx(5.0)


def test_costs_count_what_comes_before_the_first_step():
    cost = Cost(0.5, begin=2.0)
    assert cost.seconds(10) == 7.0
    assert cost.steps(7.0) == 10
    assert cost.steps(1.0) == 0
    assert replace(cost, step=0.0).steps(3.0) > 10**6


@pytest.mark.parametrize(
    ("seconds", "words"),
    [(7.26, "7.3 s"), (17.6, "18 s"), (38.2, "40 s"), (84, "85 s"), (700, "12 min"), (3000, "50 min"), (9e4, "25 h")],
)
def test_a_prediction_has_two_digits_at_most(seconds, words):
    assert in_words(seconds) == f"about {words}"
