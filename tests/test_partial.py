"""Partial updates: places, rings, what is kept, and that parts agree with the whole."""

from functools import partial

import pytest
import torch
from brushexp_losses.perceptual import Perceptual
from brushexp_policies.accuracy import Accuracy
from brushexp_policies.patches import Patches, places
from painters import SIZE, error_of, fit, gradient_of, painter_of, take
from scenes import Windowed, random_strokes
from torch.testing import assert_close

from brushexp.compositing.layers import EDGE
from brushexp.painting.canvas_memory import PatchCache, find_reaching
from brushexp.pictures.region import Region
from brushexp.plugins.blend.tiled import Tiled
from brushexp.plugins.loss.kl import KullbackLeibler
from brushexp.plugins.loss.mse import MeanSquaredError
from brushexp.plugins.optimizer.torch import TorchOptim
from brushexp.plugins.renderer.analytic import Analytic
from brushexp.plugins.renderer.textured import Textured
from brushexp.plugins.sampler.base import View
from brushexp.plugins.sampler.whole import Whole
from brushexp.registry import build_named
from brushexp.strokes.prior import clamp_to_prior

RENDERERS = {"analytic": Analytic, "textured": Textured, "windowed": Windowed}


few = partial(Patches, n_active=15, n_ring=15, patch=32)


@pytest.mark.parametrize("coverage", ["fair", "random"])
@pytest.mark.parametrize("renderer", RENDERERS)
def test_a_patch_that_covers_the_canvas_paints_the_same_picture_as_the_whole(renderer, coverage):
    everything = Patches(n_active=10**6, n_ring=0, patch=10**6, coverage=coverage)
    whole, part = (painter_of(renderer=RENDERERS[renderer](), sampler=sampler) for sampler in (Whole(), everything))
    take(whole, 12)
    take(part, 12)
    assert_close(dict(whole.strokes().items()), dict(part.strokes().items()), rtol=1e-4, atol=1e-3)
    assert_close(whole.draw_whole(), part.draw_whole(), rtol=0, atol=1e-3)


@pytest.mark.parametrize("renderer", RENDERERS)
def test_with_all_others_in_the_ring_active_strokes_feel_what_they_feel_in_the_whole(renderer):
    painter = painter_of(renderer=RENDERERS[renderer]())
    active, ring = torch.arange(60).chunk(2)
    region = Region(0, 0, *SIZE)
    whole = gradient_of(painter, View(region))
    total = painter.terms["mse"]
    part = gradient_of(painter, View(region, active, ring), painter.catalogue.part(active))
    assert_close(painter.terms["mse"], total, rtol=1e-3, atol=1e-6)  # cached windows have 16 bits
    for name, value in part.items():
        assert_close(value, whole[name][active], rtol=2e-3, atol=2e-3 * float(whole[name].abs().max()))


def test_only_active_strokes_move_and_their_past_is_remembered_from_visit_to_visit():
    painter = painter_of(sampler=few(n_active=7, patch=20))
    loop = take(painter, 0)
    for _ in range(8):
        before = [value.clone() for _, value in painter.strokes().items()]
        take(painter, 1, loop)
        pairs = zip(before, painter.strokes().items(), strict=True)
        moved = [(old != new).reshape(60, -1).any(1) for old, (_, new) in pairs]
        assert 0 < torch.stack(moved).any(0).sum() <= 7
    painter = painter_of(sampler=few(n_active=20, patch=70, steps_per_patch=2))
    optimizer = take(painter, 30)["optimizer"]
    for parameter in painter.catalogue.parameters():
        state = optimizer.state[parameter]
        assert state["exp_avg"].shape == parameter.shape
        assert (state["exp_avg_sq"].reshape(60, -1).sum(1) > 0).float().mean() > 0.6  # some lie beside the canvas
    assert painter.visits.min() >= 2


@pytest.mark.parametrize("soft", [2.0, 20.0])
def test_a_part_is_what_it_would_be_in_the_whole_however_soft_strokes_are(soft):
    painter = painter_of(renderer=Analytic(soft=soft), sampler=few(patch=24))
    strokes, whole = painter.strokes(), painter.draw_whole()
    for step in range(6):
        view = painter.components.sampler(strokes, SIZE, step, painter.generator)
        painter.training_step(view, 0)
    assert_close(painter.picture.memory.picture, whole, atol=1e-5, rtol=0)


SEARCH = {"max_iter": 4, "line_search_fn": "strong_wolfe"}  # without one it is luck whether steps in parts help
OPTIMIZERS = {"SGD": {"lr": 3.0}, "RMSprop": {}, "LBFGS": {"lr": 1.0, "options": SEARCH}, "Adafactor": {"lr": 0.01}}
PARTS = {name: {"optimizer": TorchOptim(name=name, **options)} for name, options in OPTIMIZERS.items()}
FEATURES = {"perceptual": Perceptual(), "kl": KullbackLeibler(), "mse": MeanSquaredError()}
PARTS |= {"losses": {"losses": FEATURES, "order": Accuracy(every=1)}}


@pytest.mark.parametrize(("name", "coarse"), [*((name, 0.0) for name in PARTS), ("SGD", 0.2), ("losses", 0.2)])
def test_partial_steps_lower_the_error_with_any_optimiser_and_loss_also_after_coarse_ones(name, coarse):
    painter = painter_of(steps=40, sampler=few(), options={"coarse": coarse}, **PARTS[name])
    before = error_of(painter)
    fit(painter)
    assert (painter.schedule.step, painter.stop) == (40, "")
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
    painter = painter_of(renderer=RENDERERS[renderer](), sampler=sampler(), optimizer=TorchOptim(lr=0.005))
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
    strokes, counts, step = random_strokes(200, SIZE), torch.zeros(200, dtype=torch.long), 0
    strokes.position[:20] = 5e4  # far off the canvas
    for _ in range(4):
        rounds, seen = 0, counts.clone()
        while rounds == 0 or sampler._turn < int(sampler._round.max()):
            for _ in range(3):
                view = sampler(strokes, SIZE, step, generator)
                counts[view.active] += 1
                step += 1
            rounds += 1
        assert (counts - seen == 3).all(), "once in each round, for three steps"


def test_random_coverage_takes_the_nearest_strokes_to_a_point():
    sampler, generator = Patches(n_active=12, n_ring=6, patch=1000, coverage="random"), torch.Generator()
    strokes = random_strokes(100, SIZE)
    view = sampler(strokes, SIZE, 0, generator.manual_seed(4))
    point = torch.rand(2, generator=generator.manual_seed(4)) * torch.tensor([70.0, 48.0])
    inside = strokes.position.clamp_min(0).minimum(torch.tensor([70.0, 48.0]))
    by_distance = (inside - point).norm(dim=1).argsort()
    assert set(view.active.tolist()) == set(by_distance[:12].tolist())
    assert set(view.ring.tolist()) == set(by_distance[12:18].tolist())
    again = sampler(strokes, SIZE, 1, generator)
    assert torch.equal(again.active, view.active), "the same place for five steps"
    late = Patches(n_active=12, n_ring=6, patch=1000, coverage="random")  # as after coarse steps
    assert torch.equal(late(strokes, SIZE, 3, generator.manual_seed(4)).active, view.active)


@pytest.mark.parametrize("n", [1, 2, 33])
@pytest.mark.parametrize("options", [{}, {"n_ring": 0}, {"patch": 1}, {"patch": 5, "coverage": "random"}])
def test_odd_sizes_are_defined(n, options):
    painter = painter_of(sampler=Patches(**options), n=n)
    take(painter, 6)
    assert painter.draw_whole().isfinite().all()
    assert painter.visits.sum() > 0, "strokes are found, however few there are"


def test_no_strokes_are_looked_at_whole_and_all_at_one_point_still_make_places():
    view = Patches()(random_strokes(0, SIZE), SIZE, 0, torch.Generator())
    assert (view.region, view.active) == (Region(0, 0, *SIZE), None)
    assert Patches().steps_per_round(random_strokes(0, SIZE), SIZE) == 1
    number = places(torch.zeros(100, 2), 7, 10.0, torch.Generator())
    assert number.bincount().max() <= 7
    assert (number.bincount() > 0).all()


def test_kept_pictures_are_those_of_the_renderer_drawn_once_and_within_their_memory():
    strokes, renderer = clamp_to_prior(random_strokes(30, SIZE)), Windowed()
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
    strokes = random_strokes(150, SIZE)
    steps, generator = sampler.steps_per_round(strokes, SIZE), torch.Generator().manual_seed(1)
    moved = sum(len(sampler(strokes, SIZE, step, generator).active) for step in range(10 * steps))
    assert moved / (10 * 150) == pytest.approx(1, rel=0.3)


def test_losses_keep_their_balance_on_parts_and_touched_pixels_are_those_in_the_boxes():
    losses = {name: build_named("loss", name, {"weight": weight}) for name, weight in (("mse", 3.0), ("kl", 2.0))}
    painter = painter_of(losses=losses)
    active, ring = torch.arange(60).chunk(2)
    total = painter.training_step(View(Region(7, 9, 24, 35), active, ring), 0)
    assert float(total.detach()) == pytest.approx(3 / 4 * float(painter.terms["mse"]) + 2 * float(painter.terms["kl"]))
    strokes = random_strokes(12, SIZE)
    region = Region(5, 9, 30, 41)
    result = find_reaching(strokes, region, EDGE)
    no_paint = torch.tensor([9.0, 9.0, 9.0])
    painted = region.of((Tiled(opaque=0)(Analytic()(strokes), torch.arange(12), SIZE, no_paint).image != 9).any(0))
    assert result.shape == (30, 41)
    assert (result | ~painted).all(), "no painted pixel is missed"
    assert result.float().mean() < 1
    assert not find_reaching(strokes[:0], region, EDGE).any()
