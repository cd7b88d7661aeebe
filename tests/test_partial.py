"""Partial updates: places, rings, what is kept, and that parts agree with the whole."""

from dataclasses import replace

import pytest
import torch
from painters import error_of, gradient_of, take
from painters import painter_of as some_painter
from scenes import Windowed, random_strokes
from torch.testing import assert_close

from brushexp.errors import UserError
from brushexp.painting.canvas_memory import CanvasMemory, touched
from brushexp.painting.painter import Painter
from brushexp.painting.patch_cache import PatchCache
from brushexp.pictures.region import Region
from brushexp.plugins.blend.tiled import Tiled
from brushexp.plugins.loss.base import Painting
from brushexp.plugins.loss.perceptual import Perceptual
from brushexp.plugins.loss.pixel import MeanSquaredError
from brushexp.plugins.loss.stroke import KullbackLeibler
from brushexp.plugins.optimizer.torch_optim import TorchOptim
from brushexp.plugins.order.accuracy import Accuracy
from brushexp.plugins.order.area import Area
from brushexp.plugins.order.base import front_to_back
from brushexp.plugins.renderer.analytic import Analytic
from brushexp.plugins.renderer.textured import Textured
from brushexp.plugins.sampler.base import View
from brushexp.plugins.sampler.patches import Coverage, Patches, places
from brushexp.plugins.sampler.whole import Whole
from brushexp.registry import build_named
from brushexp.strokes.catalogue import FIELDS
from brushexp.strokes.prior import clamp_to_prior

SIZE = (48, 70)
RENDERERS = {"analytic": Analytic, "textured": Textured, "windowed": Windowed}


def painter_of(sampler, renderer=None, n: int = 60, losses=None, order=None, steps: int = 1000, **options) -> Painter:
    chosen = {"sampler": sampler, "order": order or Area(), "losses": losses or {"mse": MeanSquaredError()}}
    return some_painter(n=n, renderer=renderer, steps=steps, optimizer=TorchOptim(**options), **chosen)


def assert_equal_strokes(a, b, **tolerance) -> None:
    for name in FIELDS:
        assert_close(getattr(a, name), getattr(b, name), **(tolerance or {"rtol": 0, "atol": 0}))


# A sampler that looks at everything, but goes the way of parts.
EVERYTHING = {"n_active": 10**6, "n_ring": 0, "patch": 10**6}


@pytest.mark.parametrize("coverage", Coverage)
@pytest.mark.parametrize("renderer", RENDERERS)
def test_a_patch_that_covers_the_canvas_paints_the_same_picture_as_the_whole(renderer, coverage):
    make = RENDERERS[renderer]
    whole = painter_of(Whole(), make())
    part = painter_of(Patches(**EVERYTHING, coverage=coverage), make())
    take(whole, 12)
    take(part, 12)
    assert_equal_strokes(whole.strokes(), part.strokes(), rtol=1e-4, atol=1e-3)
    assert_close(whole.drawn(), part.drawn(), rtol=0, atol=1e-3)


@pytest.mark.parametrize("renderer", RENDERERS)
def test_with_all_others_in_the_ring_active_strokes_feel_what_they_feel_in_the_whole(renderer):
    painter = painter_of(Whole(), RENDERERS[renderer]())
    everything = painter.catalogue()
    active, ring = torch.arange(60).chunk(2)
    region = Region(0, 0, *SIZE)
    wanted = gradient_of(painter, View(region))
    total = painter.terms["mse"]
    found = gradient_of(painter, View(region, active, ring), painter.catalogue.part(active))
    assert_close(painter.terms["mse"], total, rtol=1e-3, atol=1e-6)  # kept windows have 16 bits
    for name, value in found.items():
        assert_close(value, wanted[name][active], rtol=2e-3, atol=2e-3 * float(wanted[name].abs().max()))
    assert_equal_strokes(painter.catalogue(), everything)


def test_a_ring_wide_enough_makes_a_part_feel_what_it_feels_in_the_whole():
    painter = painter_of(Whole(), n=300)
    strokes = painter.catalogue()
    painter.catalogue.replace(replace(strokes, scale=0.4 * strokes.scale))  # small ones, so that a part is a part
    position = strokes.position
    region = Region(8, 16, 32, 40)
    active = (position - torch.tensor([36.0, 24.0])).norm(dim=1).topk(20, largest=False).indices
    distance = torch.cdist(position, position[active]).amin(1)
    near = distance.topk(200, largest=False).indices
    ring = near[~torch.isin(near, active)]
    wanted = gradient_of(painter, View(Region(0, 0, *SIZE)))

    def errors(ring: torch.Tensor | None) -> dict[str, torch.Tensor]:
        found = gradient_of(painter, View(region, active, ring), painter.catalogue.part(active))
        return {name: (value - wanted[name][active]).norm() for name, value in found.items()}

    with_ring, alone = errors(ring), errors(None)
    for name, error in with_ring.items():
        assert error < 0.25 * wanted[name][active].norm(), name
    assert sum(alone.values()) > sum(with_ring.values()), "the ring brings something"


def test_only_active_strokes_move():
    painter = painter_of(Patches(n_active=7, n_ring=9, patch=20))
    loop = take(painter, 0)
    for _ in range(8):
        before = painter.catalogue().map(torch.clone)
        take(painter, 1, loop)
        moved = torch.zeros(60, dtype=torch.bool)
        for name, value in painter.catalogue().items():
            moved |= (value != getattr(before, name)).reshape(60, -1).any(1)
        assert 0 < moved.sum() <= 7


def test_the_past_of_a_stroke_is_remembered_from_visit_to_visit():
    painter = painter_of(Patches(n_active=20, n_ring=20, patch=70, steps_per_patch=2))
    optimizer = take(painter, 30)["optimizer"]
    for parameter in painter.catalogue.parameters():
        state = optimizer.state[parameter]
        assert state["exp_avg"].shape == parameter.shape
        assert (state["exp_avg_sq"].reshape(60, -1).sum(1) > 0).float().mean() > 0.6  # some lie beside the canvas
    assert painter.visits.min() >= 2


@pytest.mark.parametrize("name", ["Adam", "SGD", "RMSprop", "LBFGS"])
def test_partial_steps_lower_the_error_with_any_optimiser(name):
    lr = {"SGD": 3.0, "LBFGS": 0.5}.get(name, 0.02)
    painter = painter_of(Patches(n_active=20, n_ring=20, patch=40), name=name, lr=lr)
    before = error_of(painter)
    take(painter, 60)
    after = error_of(painter)
    assert after < before


@pytest.mark.parametrize("renderer", RENDERERS)
def test_the_kept_picture_stays_near_the_truth(renderer):
    painter = painter_of(Patches(n_active=15, n_ring=15, patch=30), RENDERERS[renderer](), lr=0.005)
    take(painter, 40)
    assert float((painter.latest() - painter.drawn()).abs().mean()) < 0.01
    error = float((painter.latest() - painter.picture.target).square().mean())
    assert painter.picture.error == pytest.approx(error, rel=1e-5)


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
    sampler, generator = Patches(n_active=12, n_ring=6, patch=1000, coverage=Coverage.random), torch.Generator()
    strokes = random_strokes(100, SIZE)
    view = sampler(strokes, SIZE, 0, generator.manual_seed(4))
    point = torch.rand(2, generator=generator.manual_seed(4)) * torch.tensor([70.0, 48.0])
    inside = strokes.position.clamp_min(0).minimum(torch.tensor([70.0, 48.0]))
    by_distance = (inside - point).norm(dim=1).argsort()
    assert set(view.active.tolist()) == set(by_distance[:12].tolist())
    assert set(view.ring.tolist()) == set(by_distance[12:18].tolist())
    again = sampler(strokes, SIZE, 1, generator)
    assert torch.equal(again.active, view.active), "the same place for five steps"


@pytest.mark.parametrize("n", [1, 2, 33])
@pytest.mark.parametrize("options", [{}, {"n_ring": 0}, {"patch": 1}, {"n_active": 1}, {"coverage": Coverage.random}])
def test_odd_sizes_are_defined(n, options):
    painter = painter_of(Patches(**options), n=n)
    take(painter, 6)
    assert painter.drawn().isfinite().all()


def test_no_strokes_are_looked_at_whole():
    assert Patches()(random_strokes(0, SIZE), SIZE, 0, torch.Generator()) == View(Region(0, 0, *SIZE))


def test_all_strokes_at_one_point_still_make_places():
    number = places(torch.zeros(100, 2), 7, 10.0, torch.Generator())
    assert number.bincount().max() <= 7
    assert (number.bincount() > 0).all()


@pytest.mark.parametrize("key", ["n_active", "n_ring", "patch", "steps_per_patch"])
def test_impossible_options_are_refused_with_their_key(key):
    with pytest.raises(UserError, match=rf"sampler\.{key}=-1"):
        build_named("sampler", "patches", {key: -1})


def test_touched_pixels_are_those_in_the_boxes():
    strokes = random_strokes(12, SIZE)
    region = Region(5, 9, 30, 41)
    found = touched(strokes, region)
    canvas = Tiled(opaque=0)(
        Analytic()(strokes), torch.arange(12), SIZE, torch.tensor([9.0, 9.0, 9.0])
    )  # a background of no colour that paint has
    painted = region.of((canvas.image != 9).any(0))
    assert found.shape == (30, 41)
    assert (found | ~painted).all(), "no painted pixel is missed"
    assert found.float().mean() < 1
    assert not touched(strokes[:0], region).any()


def test_kept_pictures_are_those_of_the_renderer_and_are_drawn_once():
    strokes, renderer = clamp_to_prior(random_strokes(30, SIZE)), Windowed()
    kept, number = PatchCache(renderer, 30), torch.tensor([3, 17, 4, 29])
    for _ in range(3):
        layers = kept.layers(strokes[number], number)
    assert renderer.drawn == 4
    with torch.no_grad():
        wanted = renderer(strokes[number], number)
    assert_close(layers.images, wanted.images, rtol=0, atol=1e-3)
    assert_close(layers.position, wanted.position)
    renderer.drawn = 0
    kept.forget(torch.tensor([17, 5]))
    kept.layers(strokes[number], number)
    assert renderer.drawn == 1


def test_kept_pictures_stay_within_their_memory():
    strokes, renderer = clamp_to_prior(random_strokes(30, SIZE)), Windowed()
    kept = PatchCache(renderer, 30, most_bytes=8 * 2 * 4 * 16 * 16)  # eight windows
    with torch.no_grad():
        wanted = renderer(strokes).images
    generator = torch.Generator().manual_seed(0)
    for size in [5, 8, 8, 13, 30, 2, 8] * 3:
        number = torch.randperm(30, generator=generator)[:size]
        assert_close(kept.layers(strokes[number], number).images, wanted[number], rtol=0, atol=1e-3)
        owned = kept._owner[kept._owner >= 0]
        assert len(kept._pictures) == 8
        assert len(owned.unique()) == len(owned)
        assert torch.equal(kept._place[owned], (kept._owner >= 0).nonzero()[:, 0])


def test_features_of_a_part_see_what_surrounds_it():
    target, picture = torch.rand(2, 3, *SIZE)
    region = Region(10, 20, 24, 28)
    memory = CanvasMemory(picture.clone(), target, torch.ones(3), Analytic(), Tiled(), 0)
    memory._turn_to(View(region, torch.zeros(0, dtype=torch.long)), random_strokes(0, SIZE))
    image = torch.rand(3, 24, 28, requires_grad=True)
    painting = Painting(image, region.of(target), random_strokes(1, SIZE), memory._surroundings)
    assert torch.equal(painting.surroundings.part, painting.target)
    wide = painting.around(7)
    assert wide.image.shape == wide.target.shape == (3, 38, 42)
    assert torch.equal(wide.image[:, 7:-7, 7:-7], image)
    assert torch.equal(wide.image[:, :7], picture[:, 3:10, 13:55])
    assert wide.target is painting.around(7).target, "the same object, so that its features are computed once"
    everything = painting.around(10**6)
    assert everything.image.shape == (3, *SIZE)
    everything.image.sum().backward()
    assert (image.grad == 1).all()


def test_losses_of_strokes_and_features_work_on_parts():
    losses = {"perceptual": Perceptual(), "kl": KullbackLeibler(), "mse": MeanSquaredError()}
    painter = painter_of(Patches(n_active=15, n_ring=15, patch=32), losses=losses)
    before = error_of(painter)
    take(painter, 20)
    assert error_of(painter) < before
    assert all(term.isfinite() for term in painter.terms.values())


def test_the_order_of_accuracy_works_on_parts():
    painter = painter_of(Patches(n_active=15, n_ring=15, patch=32), order=Accuracy(every=1))
    take(painter, 40)
    assert (painter.depth.accuracy != 0).sum() > 40
    assert sorted(painter.depth.front_to_back.tolist()) == list(range(60))
    assert torch.equal(front_to_back(painter.depth.accuracy).sort().values, torch.arange(60))


def test_random_coverage_finds_strokes_however_few_there_are():
    painter = painter_of(Patches(patch=5, coverage=Coverage.random), n=3)
    take(painter, 30)
    assert painter.visits.sum() > 0


@pytest.mark.parametrize("coverage", Coverage)
@pytest.mark.parametrize("patch", [12, 30, 500])
def test_a_round_is_as_many_steps_as_move_each_stroke_once(coverage, patch):
    sampler = Patches(n_active=20, n_ring=0, patch=patch, steps_per_patch=1, coverage=coverage)
    strokes = random_strokes(150, SIZE)
    steps, generator = sampler.steps_per_round(strokes, SIZE), torch.Generator().manual_seed(1)
    moved = sum(len(sampler(strokes, SIZE, step, generator).active) for step in range(10 * steps))
    assert moved / (10 * 150) == pytest.approx(1, rel=0.3)


def test_losses_keep_their_balance_on_parts():
    losses = {"mse": MeanSquaredError(weight=3.0), "kl": KullbackLeibler(weight=2.0)}
    painter = painter_of(Whole(), losses=losses)
    active, ring = torch.arange(60).chunk(2)
    gradient_of(painter, View(Region(7, 9, 24, 35), active, ring), painter.catalogue.part(active))
    total = painter.training_step(None, 0)
    assert float(total.detach()) == pytest.approx(3 / 4 * float(painter.terms["mse"]) + 2 * float(painter.terms["kl"]))


def test_the_error_is_known_when_another_renderer_takes_over():
    painter = painter_of(Patches(n_active=15, n_ring=15, patch=30), steps=6)
    take(painter, 5)
    before = painter.picture.error
    painter.picture.forget()
    assert painter.picture.error == before
