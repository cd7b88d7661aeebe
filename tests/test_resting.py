"""Places that rest: what is looked at, that it feels as in the whole, that it goes on after a break."""

import copy
from dataclasses import replace

import pytest
import torch
from scenes import random_strokes
from torch.testing import assert_close

from brushexp.compositing.tile_lists import TILE, build_lists
from brushexp.errors import UserError
from brushexp.painting.components import Components, Stage
from brushexp.painting.painter import Painter
from brushexp.pictures.region import Region
from brushexp.plugins.blend.tiled import Tiled
from brushexp.plugins.density.fixed import Fixed
from brushexp.plugins.loss.pixel import MeanSquaredError
from brushexp.plugins.optimizer.torch_optim import TorchOptim
from brushexp.plugins.order.area import Area
from brushexp.plugins.renderer.analytic import Analytic
from brushexp.plugins.sampler.base import View
from brushexp.plugins.sampler.resting import Resting
from brushexp.plugins.sampler.whole import Whole
from brushexp.strokes.catalogue import FIELDS, Catalogue, Strokes

SIZE = (72, 110)
SLEEPY = {"share": 0.5, "fall": 2.0, "worth": 1.0, "block": 16}  # the better blocks sleep whatever their error does


def painter_of(sampler, n: int = 300, target=None, steps: int = 1000) -> Painter:
    torch.manual_seed(5)
    parts = Components(
        stages=[Stage("it", Analytic(), steps)],
        blend=Tiled(opaque=0),
        order=Area(),
        losses={"mse": MeanSquaredError()},
        density=Fixed(),
        sampler=sampler,
        optimizer=TorchOptim(),
    )
    strokes = random_strokes(n, SIZE)
    catalogue = Catalogue(replace(strokes, scale=0.5 * strokes.scale), parts.optimizer.units)
    if target is None:
        target = torch.rand(3, *SIZE)
        target[..., : SIZE[1] // 2] = 0.5 + 0.02 * target[..., : SIZE[1] // 2]  # a calm half
    return Painter(catalogue, parts, target, torch.tensor([0.5, 0.5, 0.5]), seed=0)


def take(painter: Painter, steps: int, optimizer=None) -> torch.optim.Optimizer:
    optimizer = optimizer or painter.configure_optimizers()
    for _ in range(steps):
        painter._take_step(optimizer)
    return optimizer


def test_strokes_that_are_awake_feel_what_they_feel_in_the_whole():
    painter = painter_of(Resting(**SLEEPY))
    take(painter, 41)
    view = painter.parts.sampler(painter._strokes(), SIZE, 41, painter.generator)
    assert view.active is not None
    assert 0 < len(view.active) < 300
    assert len(view.active) + len(view.ring) < 300, "some strokes are not even drawn"
    painter.zero_grad()
    painter._objective(painter.catalogue, View(Region(0, 0, *SIZE)))
    wanted = {name: value.grad[view.active] for name, value in painter.catalogue.named_parameters()}
    part = painter.catalogue.part(view.active)
    painter._objective(part, view)
    for name, value in part.named_parameters():
        assert_close(value.grad, wanted[name], rtol=1e-4, atol=1e-5 * float(wanted[name].abs().max()))


def test_strokes_that_sleep_move_only_when_all_do():
    painter = painter_of(Resting(**SLEEPY))
    optimizer = take(painter, 41)
    before = painter.catalogue()
    take(painter, 1, optimizer)
    active = painter.parts.sampler._view.active
    still = torch.ones(300, dtype=torch.bool)
    still[active] = False
    after = painter.catalogue()
    for name in FIELDS:
        assert_close(getattr(after, name)[still], getattr(before, name)[still], rtol=0, atol=0)
    assert not torch.equal(after.color[active], before.color[active])
    assert painter.visits.max() == 42 > painter.visits.min()


def test_the_error_is_that_of_the_picture_after_steps_of_either_kind():
    painter = painter_of(Resting(**SLEEPY))
    optimizer = take(painter, 10)
    for _ in range(4):
        take(painter, 1, optimizer)
        assert_close(painter.error, float((painter.latest() - painter.target).square().mean()), rtol=1e-5, atol=0)
        assert_close(painter.latest(), painter.picture(), rtol=0, atol=0.3)


def test_nothing_rests_without_a_share_and_the_steps_are_those_of_the_whole():
    whole, resting = painter_of(Whole()), painter_of(Resting(share=0.0))
    take(whole, 12)
    take(resting, 12)
    assert_close(resting.picture(), whole.picture(), rtol=0, atol=1e-3)


def test_the_picture_is_almost_that_of_the_whole():
    whole, resting = painter_of(Whole(), steps=120), painter_of(Resting(worth=1.0, block=16), steps=120)
    take(whole, 120)
    take(resting, 120)
    assert resting.visits.min() < 120, "something rested"
    errors = [float((p.picture() - p.target).square().mean()) for p in (whole, resting)]
    assert errors[1] < 1.03 * errors[0]


def test_an_interrupted_run_goes_on_with_the_same_bits():
    first = painter_of(Resting(**SLEEPY))
    optimizer = take(first, 18)  # in the middle of a rest
    checkpoint = {"state_dict": first.state_dict()}
    first.on_save_checkpoint(checkpoint)
    checkpoint, moments = copy.deepcopy((checkpoint, optimizer.state_dict()))
    second = painter_of(Resting(**SLEEPY))
    second.load_state_dict(checkpoint["state_dict"], strict=False)
    second.on_load_checkpoint(checkpoint)
    other = second.configure_optimizers()
    other.load_state_dict(moments)
    take(first, 9, optimizer)
    take(second, 9, other)
    for name in FIELDS:
        assert_close(getattr(first.catalogue(), name), getattr(second.catalogue(), name), rtol=0, atol=0)


def test_strokes_that_come_and_go_are_looked_at_in_the_whole_until_blocks_are_chosen_anew():
    sampler = Resting(**SLEEPY)
    painter = painter_of(sampler)
    take(painter, 42)
    strokes = painter._strokes()
    assert sampler(strokes, SIZE, 42, painter.generator).active is not None
    assert sampler(strokes[:200], SIZE, 42, painter.generator).active is None


@pytest.mark.parametrize("n", [0, 1, 2])
def test_a_few_strokes_or_a_perfect_picture_are_no_trouble(n):
    painter = painter_of(Resting(**SLEEPY), n=n, target=torch.full((3, *SIZE), 0.5))
    take(painter, 9)
    assert painter.picture().isfinite().all()


@pytest.mark.parametrize(
    ("options", "cure"),
    [
        ({"every": 1}, "sampler.every=4"),
        ({"share": 1.5}, "sampler.share"),
        ({"worth": -1.0}, "sampler.worth"),
        ({"block": 0}, "sampler.block=32"),
    ],
)
def test_wrong_options_are_refused_with_the_cure(options, cure):
    with pytest.raises(UserError, match=cure):
        Resting(**options)


def test_the_order_is_renewed_in_the_first_half_of_a_stage_only():
    order = Area(every=10)
    assert [done for done in range(60) if order.due(done, 60)] == [0, 10, 20]
    assert order.due(0, 1), "a stage of one step begins with an order, too"


def test_a_pair_is_listed_if_and_almost_only_if_the_stroke_reaches_a_pixel_of_the_tile():
    strokes: Strokes = random_strokes(400, SIZE, seed=3)
    layers = Analytic()(strokes)
    lists = build_lists(layers.curve.reshape(-1, 6).numpy(), layers.reach.numpy(), SIZE)
    rows, columns = lists.shape
    listed = torch.zeros(rows * columns, 400, dtype=torch.bool)
    for tile in range(rows * columns):
        listed[tile, torch.from_numpy(lists.stroke[lists.first[tile] : lists.first[tile + 1]]).long()] = True
    pixel, tile = torch.arange(TILE * TILE), torch.arange(rows * columns)[:, None]
    points = torch.stack([tile % columns * TILE + pixel % TILE, tile // columns * TILE + pixel // TILE], -1) + 0.5
    opaque = replace(layers, opacity=torch.ones(400))
    alpha, _ = opaque.sample(torch.arange(400).expand(rows * columns, -1), points)
    covers = (alpha > 1e-6).any(-1)
    assert listed[covers].all(), "nothing that can be seen is left out"
    assert covers.sum() > 0.9 * listed.sum()
