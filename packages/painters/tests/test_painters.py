"""Test that painters work with the driver that displays, ends and measures their paintings."""

import signal
from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from brushexp_painters.gatys import lattice_dots
from brushexp_painters.hertzmann import fit_curves
from brushexp_testing.families import request_of
from lightning.pytorch.callbacks import LambdaCallback
from painters import fit, painter_of
from refusals import refuses
from torch.testing import assert_close

from brushexp.config.check import check
from brushexp.painting.build import build_painter
from brushexp.painting.components import standard_components
from brushexp.painting.goals import goals_of
from brushexp.painting.other_painter import OtherPainter
from brushexp.painting.timelapse import Timelapse
from brushexp.pictures.structure import worst_of_cells
from brushexp.plugins.painter.base import Painter, PaintState
from brushexp.registry import build, build_named, plugins
from brushexp.strokes.bezier import point_at
from brushexp.strokes.catalogue import check_strokes
from brushexp.strokes.prior import sample_prior
from brushexp.system.callbacks import TimedCheckpoint
from brushexp.tasks import paint

TARGET = torch.rand(3, 24, 40, generator=torch.Generator().manual_seed(0))
NAMES = [plugin.name for plugin in plugins("painter") if issubclass(plugin.cls, Painter)]
QUICK = {"evolution": {"children": 5}, "gatys": {"steps": 3}, "predictor": {"temperature": 1.0}}


class Counting(Painter):
    """A painter that adds one stroke per state, and calls ``then`` after each state."""

    def __init__(self, states=10, then=lambda step: None):
        self.states, self.then = states, then

    def __call__(self, request):
        for step in range(1, self.states + 1):
            yield PaintState(sample_prior(step, seed=0).moved(zoom=20.0, shift=(10, 10)), 3 * step, 3 * self.states)
            self.then(step)


def fit_states(method, *callbacks, **goals):
    painter = OtherPainter(method, standard_components(), TARGET, torch.ones(3), n=50, seed=0)
    goals = goals_of(**{"early_stop": None, "psnr": None, "seconds": None} | goals, has_plan=False)
    fit(painter, [*goals, *callbacks, TimedCheckpoint(None, None)])
    return painter


def test_all_states_are_shown_filmed_and_counted_and_fewer_strokes_than_promised_are_all_there_is():
    film = Timelapse(5, 32)
    painter = fit_states(Counting(), film)
    assert painter.schedule.step == painter.schedule.steps == 30
    assert painter.trainer.global_step == 10
    assert (len(painter.strokes()), painter.stop, painter.progress) == (10, None, 1.0)
    assert_close(painter.latest(), painter.draw_whole())
    assert painter.anytime[-1][1] > 0
    assert set(film.state_dict()["steps"]) > {0, 30}

    class Lazy(Counting):
        def __call__(self, request):
            yield from list(super().__call__(request))[:4]

    painter = fit_states(Lazy())
    assert (painter.schedule.step, painter.schedule.steps, painter.is_done) == (12, 12, True)


@pytest.mark.parametrize("by_steps", [True, False])
def test_cpu_seconds_are_those_of_the_steps(by_steps):
    """CPU seconds exclude compilation, which precedes the steps and would make the first run the slowest."""
    procedure = OtherPainter(Counting(), standard_components(), TARGET, torch.ones(3), n=50, seed=0)
    painter = painter_of(steps=4) if by_steps else procedure
    spent, prepare = SimpleNamespace(cpu=7.0), painter.prepare

    def spend(seconds):
        spent.cpu += seconds

    painter.schedule.cpu_clock = lambda: spent.cpu
    painter.prepare = lambda: (prepare(), spend(100))
    trainer = fit(painter, [LambdaCallback(on_train_batch_end=lambda *_: spend(1), on_fit_end=lambda *_: spend(100))])
    assert painter.schedule.cpu_seconds == trainer.global_step == (4 if by_steps else 10)


@pytest.mark.parametrize(("interrupted_at", "goals", "status", "n"), [
    (0, {"seconds": 0.0}, "seconds spent", 1), (0, {"psnr": 0.5}, "psnr reached", 1), (4, {}, "interrupted", 5),
])  # fmt: skip
def test_a_goal_or_ctrl_c_ends_it_after_a_state(interrupted_at, goals, status, n):
    method = Counting(then=lambda step: signal.raise_signal(signal.SIGINT) if step == interrupted_at else None)
    painter = fit_states(method, **goals)
    assert (painter.stop, len(painter.strokes())) == (status, n)


@pytest.mark.parametrize("name", NAMES)
def test_a_painting_is_nearer_to_the_picture_than_bare_canvas_and_seeds_differ(name):
    target = torch.nn.functional.interpolate(TARGET[None, :, ::6, ::8], TARGET.shape[1:], mode="bilinear")[0]
    bare = target.mean((1, 2))
    pictures = []
    for seed in (1, 2):
        request = replace(request_of(target, 80, bare), generator=torch.Generator().manual_seed(seed))
        *_, last = build_named("painter", name, QUICK.get(name, {}))(request)
        pictures.append(request.draw(last.strokes))
        assert (pictures[-1] - target).square().mean() < 0.9 * (bare[:, None, None] - target).square().mean()
    assert not torch.equal(*pictures)


@pytest.mark.parametrize("name", NAMES)
def test_a_picture_of_no_numbers_ends_it_with_the_state_before(name, monkeypatch):
    whole, drawn = OtherPainter.draw_strokes, []

    def draw(painter, strokes):
        drawn.append(len(strokes))
        return whole(painter, strokes) * (torch.nan if len(drawn) > 3 else 1)

    monkeypatch.setattr(OtherPainter, "draw_strokes", draw)
    painters = []
    note = LambdaCallback(on_train_start=lambda _, painter: painters.append(painter))
    words = r"picture that is not finite|: \w+ is nan"
    refuses(words, fit_states, build_named("painter", name, QUICK.get(name, {})), note)
    assert len(drawn) > 3
    check_strokes(painters[0].strokes())
    monkeypatch.undo()
    assert painters[0].draw_whole().isfinite().all()


@pytest.mark.parametrize(("broken", "message"), [
    (lambda state: None, "yielded NoneType, not a PaintState"),
    (lambda state: state.strokes, "yielded Strokes, not a PaintState"),
    (lambda state: PaintState(state.strokes.map(lambda value: value * torch.nan), 1, 9), "position is nan, nan"),
    (lambda state: PaintState(sample_prior(51, seed=0), 1, 9), "yielded 51 strokes, but 50 are allowed"),
])  # fmt: skip
def test_what_a_painter_yields_that_is_no_state_is_told_with_its_name(broken, message):
    class Broken(Counting):
        def __call__(self, request):
            for k, state in enumerate(super().__call__(request)):
                yield broken(state) if k == 4 else state

    refuses(f"painter=Broken .*{message}.*correct the painter", fit_states, Broken())


@pytest.mark.parametrize("name", ["haeberli", "hertzmann"])
def test_a_run_leaves_what_any_painting_leaves(run_task, config, tmp_path, caplog, name):
    words = ("image=astronaut", "resolution=48", "strokes=60", "frames=4", "steps=3", "look=plain")
    with caplog.at_level("WARNING"):
        metrics = run_task(paint, f"painter={name}", *words)
    assert f"painter={name} ignores steps" in caplog.text
    options = ((), ("style=coffee", "focus=auto"))
    plain, styled = (build_painter(config(f"painter={name}", *words, *more)) for more in options)
    assert styled.pictures.keys() == {"target"}
    assert torch.equal(styled.pictures["target"], plain.pictures["target"])
    again = (f"catalogue={tmp_path}/catalogue.h5", "init.length=5")
    check(config(*again), again)
    assert "catalogue.h5, so init.length has no effect" in caplog.text
    assert "catalogue.h5 get a new order; order=fixed keeps their own" in caplog.text
    assert (metrics["painter"], metrics["status"]) == (name, "completed")
    assert 0 < metrics["n_strokes"] <= 60
    assert metrics["psnr"] > 8
    for file in ("painting.png", "catalogue.h5", "strokes.svg", "report.html", "timelapse.mp4"):
        assert (tmp_path / file).is_file(), file


@pytest.mark.parametrize(("style", "radii", "f_c", "opacity", "f_g", "lengths", "rgb", "hsv"), [  # Hertzmann (1998)
    ("impressionist", (8, 4, 2), 1, 1, 1, (4, 16), 0, (0, 0, 0)),
    ("expressionist", (8, 4, 2), 0.25, 0.7, 1, (10, 16), 0, (0, 0, 0.5)),
    ("wash", (8, 4, 2), 1, 0.5, 1, (4, 16), 0.3, (0, 0, 0)),
    ("pointillist", (4, 2), 1, 1, 0.5, (0, 0), 0, (0.3, 0, 1)),
])  # fmt: skip
def test_presets_of_hertzmann_have_the_styles_of_the_paper(config, style, radii, f_c, opacity, f_g, lengths, rgb, hsv):
    painter = build(config(f"painter=hertzmann_{style}", "image=astronaut").painter)
    assert (tuple(painter.radii), painter.curvature, painter.opacity, painter.grid) == (radii, f_c, opacity, f_g)
    assert ((painter.min_length, painter.max_length), painter.blur) == (lengths, 0.5)
    assert (painter.jitter_rgb, tuple(painter.jitter_hsv)) == (rgb, hsv)


def test_curves_follow_their_lines_within_the_tolerance():
    random = np.random.default_rng(0)
    turn = np.cumsum(random.normal(0, 0.6, (40, 16)), 1)
    points = np.cumsum(np.stack([np.cos(turn), np.sin(turn)], 2), 1)
    steps = random.integers(0, 16, 40)
    owner, curves = fit_curves(points, steps, 0.3)
    assert (np.diff(owner) >= 0).all()
    for line in range(40):
        own = curves[owner == line]
        assert_close(own[0, 0], points[line, 0])
        assert_close(own[-1, 2], points[line, steps[line]])
        assert_close(own[1:, 0], own[:-1, 2])  # consecutive curves meet
        fine = point_at(torch.tensor(own)[:, None], torch.linspace(0, 1, 200)[None].double()).reshape(-1, 2).numpy()
        away = np.linalg.norm(points[line, : steps[line] + 1, None] - fine, axis=2).min(1)
        assert away.max() < 0.3 + 0.02
    assert len(fit_curves(points, steps, 100.0)[0]) == 40


def test_the_worst_pixel_is_found_as_by_a_loop_and_children_live_only_where_the_picture_gains():
    difference = np.random.default_rng(1).random((10, 13))
    cells, x, y = worst_of_cells(difference, 4)
    corners = [(top, left) for top in range(0, 10, 4) for left in range(0, 13, 4)]
    blocks = [difference[top : top + 4, left : left + 4] for top, left in corners]
    assert np.nanmean(cells, 1) == pytest.approx([block.mean() for block in blocks])
    assert difference[y, x].tolist() == [block.max() for block in blocks]
    assert [place[0] for place in worst_of_cells(np.full((3, 3), np.nan), 4)[1:]] == [0, 0]
    request = request_of(TARGET, 40, TARGET.mean((1, 2)))
    states = build_named("painter", "evolution", {"children": 20})(request)
    errors = [float((request.draw(state.strokes) - TARGET).square().mean()) for state in states]
    assert errors[-1] < 0.95 * errors[0]
    assert all(later <= earlier + 1e-6 for earlier, later in pairwise(errors))


@pytest.mark.parametrize("n", [TARGET[0].numel(), 40, 7])
def test_dots_cover_the_canvas(n):
    black, white = (request_of(TARGET, n, torch.full((3,), shade)) for shade in (0.0, 1.0))
    dots = lattice_dots(black)
    assert 0.7 * n <= len(dots) <= n
    assert (white.draw(dots) - black.draw(dots)).mean() < 0.05
