"""Places that rest: what is looked at, that it feels as in the whole, that it goes on after a break."""

from dataclasses import replace

import pytest
import torch
from painters import error_of, gradient_of, take
from painters import painter_of as some_painter
from scenes import random_strokes
from torch.testing import assert_close

from brushexp.compositing.tile_lists import TILE, build_lists
from brushexp.errors import UserError
from brushexp.painting.painter import Painter
from brushexp.pictures.region import Region
from brushexp.plugins.order.area import Area
from brushexp.plugins.renderer.analytic import Analytic
from brushexp.plugins.sampler.base import View
from brushexp.plugins.sampler.resting import Resting
from brushexp.plugins.sampler.whole import Whole
from brushexp.registry import build_named
from brushexp.strokes.catalogue import FIELDS, Strokes

SIZE = (72, 110)
SLEEPY = {"share": 0.5, "fall": 2.0, "max_awake": 1.0, "block": 16}  # the better blocks sleep whatever their error does


def painter_of(sampler, n: int = 300, target=None, steps: int = 1000) -> Painter:
    torch.manual_seed(5)
    strokes = random_strokes(n, SIZE)
    if target is None:
        target = torch.rand(3, *SIZE)
        target[..., : SIZE[1] // 2] = 0.5 + 0.02 * target[..., : SIZE[1] // 2]  # a calm half
    strokes = replace(strokes, scale=0.5 * strokes.scale)
    return some_painter(strokes=strokes, target=target, steps=steps, sampler=sampler)


def test_strokes_that_are_awake_feel_what_they_feel_in_the_whole():
    painter = painter_of(Resting(**SLEEPY))
    take(painter, 41)
    view = painter.components.sampler(painter.strokes(), SIZE, 41, painter.generator)
    assert view.active is not None
    assert 0 < len(view.active) < 300
    assert len(view.active) + len(view.ring) < 300, "some strokes are not even drawn"
    wanted = gradient_of(painter, View(Region(0, 0, *SIZE)))
    for name, value in gradient_of(painter, view, painter.catalogue.part(view.active)).items():
        whole = wanted[name]
        assert_close(value, whole[view.active], rtol=1e-4, atol=1e-5 * float(whole.abs().max()))


def test_strokes_that_sleep_move_only_when_all_do():
    painter = painter_of(Resting(**SLEEPY))
    optimizer = take(painter, 41)
    before = painter.catalogue()
    take(painter, 1, optimizer)
    active = painter.components.sampler._view.active
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
        assert_close(
            painter.picture.error, float((painter.latest() - painter.picture.target).square().mean()), rtol=1e-5, atol=0
        )
        assert_close(painter.latest(), painter.drawn(), rtol=0, atol=0.3)


def test_nothing_rests_without_a_share_and_the_steps_are_those_of_the_whole():
    whole, resting = painter_of(Whole()), painter_of(Resting(share=0.0))
    take(whole, 12)
    take(resting, 12)
    assert_close(resting.drawn(), whole.drawn(), rtol=0, atol=1e-3)


def test_the_picture_is_almost_that_of_the_whole():
    whole, resting = painter_of(Whole(), steps=120), painter_of(Resting(max_awake=1.0, block=16), steps=120)
    take(whole, 120)
    take(resting, 120)
    assert resting.visits.min() < 120, "something rested"
    errors = [error_of(p) for p in (whole, resting)]
    assert errors[1] < 1.03 * errors[0]


def test_strokes_that_come_and_go_are_looked_at_in_the_whole_until_blocks_are_chosen_anew():
    sampler = Resting(**SLEEPY)
    painter = painter_of(sampler)
    take(painter, 42)
    strokes = painter.strokes()
    assert sampler(strokes, SIZE, 42, painter.generator).active is not None
    assert sampler(strokes[:200], SIZE, 42, painter.generator).active is None


@pytest.mark.parametrize("n", [0, 1, 2])
def test_a_few_strokes_or_a_perfect_picture_are_no_trouble(n):
    painter = painter_of(Resting(**SLEEPY), n=n, target=torch.full((3, *SIZE), 0.5))
    take(painter, 9)
    assert painter.drawn().isfinite().all()


@pytest.mark.parametrize(
    ("options", "cure"),
    [
        ({"every": 1}, "sampler.every=1 is not at least 2; try sampler.every=2"),
        ({"share": 1.5}, "sampler.share"),
        ({"max_awake": -1.0}, "sampler.max_awake"),
        ({"block": 0}, "sampler.block=1"),
    ],
)
def test_wrong_options_are_refused_with_the_cure(options, cure):
    with pytest.raises(UserError, match=cure):
        build_named("sampler", "resting", options)


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
