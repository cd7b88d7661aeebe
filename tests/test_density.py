"""Tests of density policies, which add and remove strokes where the picture requires it."""

import math
from dataclasses import replace

import pytest
import torch
from brushexp_policies.accuracy import Accuracy
from brushexp_policies.patches import Patches
from painters import error_of, take
from painters import painter_of as some_painter
from scenes import Windowed, random_strokes, straight

from brushexp.painting.densification import importance
from brushexp.painting.picture import Depth, Picture
from brushexp.pictures.similarity import psnr_of
from brushexp.plugins.blend.tiled import Tiled
from brushexp.plugins.density._worst_places import new_strokes
from brushexp.plugins.density.adaptive import Adaptive
from brushexp.plugins.density.base import DensificationState
from brushexp.plugins.density.fixed import Fixed
from brushexp.plugins.density.strays import Strays
from brushexp.plugins.init.slic import Slic
from brushexp.plugins.optimizer.torch import TorchOptim
from brushexp.plugins.renderer.analytic import Analytic
from brushexp.plugins.sampler.whole import Whole
from brushexp.strokes.catalogue import Strokes, check_strokes

SIZE = (40, 56)


def picture(size=SIZE):
    """Make a picture with a flat left half and a striped right half."""
    y, x = torch.meshgrid(torch.arange(size[0]) + 0.5, torch.arange(size[1]) + 0.5, indexing="ij")
    stripes = 0.5 + 0.4 * torch.sin(1.3 * x + 0.9 * y)
    right = x > size[1] / 2
    return torch.stack([torch.where(right, stripes, 0.3), torch.where(right, 1 - stripes, 0.5), torch.full(size, 0.4)])


def painter_of(density, *, n=60, steps=60, target=None, sampler=None, **options):
    """Make a painter with a budget of ``n`` strokes; its target is `picture` unless ``target`` is given."""
    target = picture() if target is None else target
    strokes = Slic()(target, density.first(n, steps), torch.Generator().manual_seed(0))
    optimizer = TorchOptim(options={"betas": [0.9, 0.99]})
    chosen = {"density": density, "sampler": sampler or Whole(), "blend": Tiled(), "optimizer": optimizer}
    return some_painter(strokes=strokes, target=target, steps=steps, options=options | {"budget": n}, **chosen)


def painted(density, **options):
    """Make a painter that has taken all of its steps."""
    painter = painter_of(density, **options)
    take(painter, painter.schedule.steps)
    return painter


def state_of(n=40, *, error=0.5, target=None, strokes=None, scores=None, focus=None, budget=100, step=30, steps=60):
    """Make a densification state in which the painting differs from the target by ``error``."""
    target = torch.rand(3, *SIZE) if target is None else target
    strokes = random_strokes(n, target.shape[1:]) if strokes is None else strokes
    scores = torch.ones(len(strokes)) if scores is None else scores
    return DensificationState(target + error, target, focus, strokes, budget, step, steps, lambda: scores)


def importance_of(strokes, order, target, *, renderer=None, blend=None, focus=None, seed=0):
    """Compute how much the squared error would grow if each stroke were removed."""
    picture = Picture(target, focus, torch.tensor([0.2, 0.5, 0.9]), blend or Tiled())
    picture.renderer = renderer or Analytic()
    return importance(strokes, order, picture, torch.Generator().manual_seed(seed))


@pytest.mark.parametrize("focus", [None, 0.5 + torch.rand(SIZE)])
def test_importance_of_any_blend_is_on_average_what_a_kernel_finds(focus):
    scene = random_strokes(12, SIZE), torch.randperm(12), torch.rand(3, *SIZE)
    exact, eager = importance_of(*scene, blend=Tiled(opaque=0), focus=focus), Tiled(opaque=0, kernel="torch")
    probed = torch.stack([importance_of(*scene, blend=eager, focus=focus, seed=k) for k in range(20)])
    spread = probed.std(0) / math.sqrt(20)
    assert ((probed.mean(0) - exact).abs() <= 5 * spread + 1e-3 * exact.abs().max()).all()


@pytest.mark.parametrize("n", [0, 9])
def test_importance_of_windows_and_of_no_strokes_is_finite(n):
    result = importance_of(random_strokes(n, SIZE), torch.arange(n), torch.rand(3, *SIZE), renderer=Windowed())
    assert result.shape == result[result.isfinite()].shape == (n,)


def test_new_strokes_lie_where_the_error_is_in_its_colour_along_its_edge_and_in_the_focus():
    target = torch.full((3, 40, 60), 0.5)
    target[:, 20:23, 30:50] = torch.tensor([0.9, 0.1, 0.2])[:, None, None]
    new = new_strokes(state_of(5, error=0.5 - target, target=target), 8, 0.5, 0.01)
    check_strokes(new)
    x, y = new.position.T
    assert ((x > 28) & (x < 52) & (y > 18) & (y < 25)).all()
    chord = (new.end - new.start)[(x > 32) & (x < 48) & (y > 20.4) & (y < 22.6)]
    assert (chord[:, 0].abs() > 3 * chord[:, 1].abs()).all()
    focus = torch.full(SIZE, 0.1)
    focus[:, 30:] = 3.7
    assert (new_strokes(state_of(5, focus=focus), 4, 0.5, 0.0).position[:, 0] >= 28).all(), "the error counts by it"


@pytest.mark.parametrize("n", [0, 3])
@pytest.mark.parametrize("size", [(1, 1), (1, 9), (2, 2), (5, 3), (40, 56)])
def test_places_of_any_picture_lie_on_it(size, n):
    new = new_strokes(state_of(n, target=torch.rand(3, *size)), 1000, 0.25, 0.0)
    assert 0 < len(new) <= size[0] * size[1]
    assert (new.position < torch.tensor([size[1], size[0]])).all()
    check_strokes(new)


def test_adaptive_paints_better_than_fixed_and_a_good_painting_needs_no_more_strokes():
    target = picture((72, 96))
    fixed, adaptive = (painted(density, target=target, n=150, steps=200) for density in (Fixed(), Adaptive()))
    assert psnr_of(error_of(adaptive)) > psnr_of(error_of(fixed)) + 0.3
    flat = painted(Adaptive(tolerance=0.02), target=torch.full((3, *SIZE), 0.3), n=50)
    assert len(flat.catalogue) <= 35, "a flat picture ends with the strokes it began with"
    refused = {0.0: Adaptive(), 0.001: Adaptive(), 0.01: Adaptive(psnr=35)}
    assert all(density.revise(state_of(error=error)) is None for error, density in refused.items())
    assert Adaptive(psnr=45).revise(state_of(error=0.01)) is not None
    scores = torch.ones(40)
    scores[5] = 0
    update = Adaptive().revise(state_of(error=0.001, scores=scores))
    assert (~update.keep).nonzero().tolist() == [[5]]
    assert len(update.new) == 0
    update = Adaptive(moved=0.25).revise(state_of(scores=torch.arange(40) + 1.0, budget=40))
    assert update.keep.tolist() == [False] * 10 + [True] * 30
    assert len(update.new) == 10
    density = Adaptive()
    assert sum(density.revise(state_of(step=step, steps=40)) is not None for step in range(1, 41)) == 3
    for none in (Adaptive(rounds=0), Adaptive(until=0.0)):
        assert (none.revise(state_of()), none.first(60, 500)) == (None, 60)


def test_coarse_steps_look_at_the_smaller_picture_leave_strokes_in_place_and_know_their_error():
    painter, seen = painter_of(Fixed(), steps=20, coarse=0.5), []
    loop = take(painter, 0)
    painter.losses["mse"].register_forward_hook(lambda module, args, out: seen.append(args[0]))
    while painter.schedule.step < painter.schedule.steps:
        take(painter, 1, loop)
        assert painter.latest().shape == painter.picture.target.shape
        assert math.isfinite(painter.picture.error)
    assert [each.image.shape[1:] for each in seen] == [(20, 28)] * 10 + [SIZE] * 10
    assert float(seen[0].strokes.scale.mean() / seen[-1].strokes.scale.mean()) == pytest.approx(0.5)
    target = torch.nn.functional.interpolate(torch.rand(1, 3, 5, 7), SIZE, mode="bicubic")[0].clamp(0, 1)
    coarse, full = (painted(Fixed(), steps=100, coarse=share, target=target) for share in (0.5, 0.0))
    assert psnr_of(coarse.picture.error) == pytest.approx(psnr_of(full.picture.error), abs=1.5)
    coarse = painted(Fixed(), steps=40, coarse=0.99, target=torch.rand(3, *SIZE))
    assert psnr_of(coarse.picture.error) < psnr_of(error_of(coarse)) + 1, "never better than the painting looks"
    odd = painted(Fixed(), n=4, target=torch.rand(3, 7, 5), coarse=0.5, focus=torch.ones(7, 5), steps=10)
    assert odd.draw_whole().isfinite().all()


PARTS = {"sampler": Patches(n_active=20, n_ring=10, patch=32)}


@pytest.mark.parametrize(("steps", "options"), [(0, {}), (10, {}), (11, {}), (200, {"coarse": 0.9}), (120, PARTS)])
def test_all_strokes_that_were_asked_for_are_there_in_the_end(steps, options):
    """All requested strokes are there in the end, even if a run is too short for rounds, or coarse steps skip some."""
    painter = painted(Adaptive(), n=60, steps=steps, **options)
    assert len(painter.catalogue) == len(painter.visits) == 60
    check_strokes(painter.strokes())


def test_strokes_lie_as_they_lay_when_others_go_and_come():
    depth = Depth(Accuracy())
    depth.front_to_back, depth.accuracy = torch.tensor([3, 0, 4, 1, 2]), torch.tensor([0.3, 0.1, 0.0, 0.9, 0.2])
    depth.revise(torch.tensor([True, False, True, True, True]), new=2)
    assert depth.front_to_back.tolist() == [5, 4, 2, 0, 3, 1]
    assert depth.accuracy.tolist() == pytest.approx([0.3, 0.0, 0.9, 0.2, 1, 1])


def test_hairlines_and_strokes_across_the_others_go_where_the_picture_hardly_misses_them():
    strokes = Slic()(torch.rand(3, 60, 60), 49, torch.Generator().manual_seed(0))
    y, x = torch.meshgrid(torch.arange(7.0), torch.arange(7.0), indexing="ij")
    place, end = torch.stack([x, y], -1).reshape(-1, 2) * 8 + 6, torch.tensor([[0.5, 0.05]]).repeat(49, 1)
    end[[10, 24, 31]] = torch.tensor([0.05, -0.5])  # perpendicular to the others
    scale, width = torch.full((49,), 16.0), torch.full((49,), 0.2)  # 3.2 pixels
    width[[17, 40]] = 0.05
    lines = {"position": place, "start": -end, "control": 0 * end, "end": end, "scale": scale, "width": width}
    scores, policy = torch.ones(49) * 1e-3, Strays(missed=0.04)
    scores[[24, 40]] = 5.0  # important strokes
    state = state_of(strokes=replace(strokes, **lines), target=torch.rand(3, 60, 60), scores=scores)
    assert (~policy.revise(state).keep).nonzero()[:, 0].tolist() == [10, 17, 31]
    eye = torch.zeros(60, 60, dtype=torch.bool)
    eye[:24] = True
    assert (~Strays().revise(replace(state, features=eye)).keep).nonzero()[:, 0].tolist() == [31]
    assert Strays(thin=0, askew=90, lone=0).revise(state) is None
    fresh = Strays(missed=0.04)
    assert next(step for step in range(1, 61) if fresh.due(step, 60)) == 42
    assert fresh.due(50, 60), "also where the number of steps has changed, so that 42 was passed by"
    assert not policy.due(50, 60), "once"
    fresh.load_state_dict(policy.state_dict())
    assert not fresh.due(50, 60)
    fixed, asked, blind = (
        painted(d, n=150) for d in (Fixed(), Strays(thin=2.5, missed=0.02), Strays(thin=2.5, missed=1))
    )
    assert len(blind.strokes()) < len(asked.strokes()) < len(fixed.strokes())
    assert error_of(asked) < 0.8 * error_of(blind)


def test_marks_that_stand_alone_go_unless_the_picture_has_a_cause_for_them():
    grey, dark = (0.6, 0.6, 0.6), (0.3, 0.3, 0.3)
    specks = [straight((x, 20), (x + 6, 20), width=3, color=dark) for x in (20, 60)]
    line = [straight((x, 50), (x + 8, 50), width=3, color=dark) for x in range(10, 80, 8)]
    ground = straight((0, 35), (100, 35), width=90, color=grey)
    broad = straight((70, 35), (74, 35), width=12, color=dark)  # hides the ground
    edge = straight((94, 60), (98, 60), width=3, color=dark)
    target = torch.full((3, 70, 100), 0.6)
    target[:, 18:22, 60:67] = 0.3  # so the second speck is justified
    strokes = Strokes.join(ground, *specks, *line, broad, edge)
    image = torch.full((3, 70, 100), 0.6)
    for left, top in ((20, 18), (60, 18)):
        image[:, top : top + 3, left : left + 7] = 0.3
    image[:, 48:52, 10:82] = 0.3
    image[:, 29:41, 64:80] = 0.3
    image[:, 58:62, 92:100] = 0.3
    state = replace(state_of(strokes=strokes, target=target), image=image)
    policy = {"thin": 0, "askew": 90}
    assert (~Strays(**policy).revise(state).keep).nonzero()[:, 0].tolist() == [1]
    assert Strays(**policy, lone=0).revise(state) is None
    attended = torch.ones(70, 100)
    attended[:, :40] = 2
    assert Strays(**policy).revise(replace(state, focus=attended)) is None


def test_a_smaller_picture_has_the_error_of_its_pixels_as_squares():
    target, focus = torch.rand(3, 24, 40), torch.rand(24, 40) + 0.5
    picture, small = Picture(target, focus, torch.ones(3), Tiled()), torch.rand(3, 6, 10)
    picture.renderer = Analytic()
    picture.show(small, 0.25)
    squares = small.repeat_interleave(4, 1).repeat_interleave(4, 2)
    assert picture.error == pytest.approx(float((squares - target).square().mean()), rel=1e-5)
    assert torch.equal(picture.at(0.25).last, small)
    assert picture.at(0.5).last is None
    assert picture.at(1.0) is picture
    torch.testing.assert_close(picture.at(0.25).focus.mean(), focus.mean())
