"""Tests of density=worth: strokes stay only while their gain exceeds the price of their bits."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from painters import BACKGROUND, assert_resumes, error_of, take
from painters import painter_of as some_painter
from scenes import random_strokes
from typed import configured

from brushexp.cli.program import expand_arguments
from brushexp.config.vocabulary import meaning_of
from brushexp.pages.run_page import _curves
from brushexp.painting.build import build_painter
from brushexp.pictures.similarity import psnr_of
from brushexp.plugins.blend.tiled import Tiled
from brushexp.plugins.density._proposals import patches_of, proposals
from brushexp.plugins.density.base import DensificationState
from brushexp.plugins.density.worth import BITS, Worth
from brushexp.plugins.init.slic import Slic
from brushexp.plugins.optimizer.torch import TorchOptim
from brushexp.strokes.catalogue import Strokes, check_strokes

SIZE = (40, 56)
MILLION = 1e6


def emblem(size=SIZE):
    """Make a picture of a disc and a bar on a plain background."""
    y, x = torch.meshgrid(torch.arange(size[0]) + 0.5, torch.arange(size[1]) + 0.5, indexing="ij")
    picture = torch.full((3, *size), 0.9)
    picture[:, (x - size[1] / 3).square() + (y - size[0] / 2).square() < (size[0] / 4) ** 2] = 0.2
    picture[0, (x > 0.7 * size[1]) & (x < 0.8 * size[1])] = 0.1
    return picture


def painter_of(density, *, target=None, steps=60, budget=300, n=None, **options):
    target = emblem() if target is None else target
    strokes = Slic()(target, n or density.first(budget, steps), torch.Generator().manual_seed(0))
    optimizer = TorchOptim(options={"betas": [0.9, 0.99]})
    parts = {"density": density, "optimizer": optimizer, "blend": Tiled(opaque=0)}
    return some_painter(strokes=strokes, target=target, steps=steps, options={"budget": budget} | options, **parts)


def painted(density, **options):
    painter, loop = painter_of(density, **options), None
    while painter.schedule.step < painter.schedule.steps:
        loop = take(painter, 1, loop)
    painter.hand_over()
    return painter


def state_of(image, target, *, strokes=None, **options):
    strokes = random_strokes(3, target.shape[1:]) if strokes is None else strokes
    given = {"focus": None, "budget": 100, "step": 10, "steps": 60, "importance": lambda: torch.ones(len(strokes))}
    return DensificationState(image=image, target=target, strokes=strokes, **(given | options))


def growth_without(painter, number):
    """Compute how much the squared error grows when the picture is composited without one stroke."""
    strokes, order, picture = painter.strokes(), painter.front_to_back, painter.picture
    rest = torch.arange(len(strokes)) != number
    ranks = order[order != number]
    without = picture.draw(strokes[rest], ranks - (ranks > number).long())
    return float((without - picture.target).square().sum()) - error_of(painter) * picture.target.numel()


def test_a_stroke_stays_exactly_if_compositing_without_it_costs_more_than_its_price():
    painter = painter_of(Worth(), target=torch.rand(3, *SIZE), n=24)
    painter.prepare()
    slow = torch.tensor([growth_without(painter, number) for number in range(len(painter.strokes()))])
    state = painter._state_for_policy(painter.draw_whole())
    torch.testing.assert_close(state.importance(), slow, rtol=1e-3, atol=1e-3)
    price = float(slow.sort().values[10:12].mean())
    update = Worth(price=price / BITS).revise(state)
    assert update.keep.tolist() == (slow > price).tolist()


@pytest.mark.parametrize("size", [(24, 31), (3, 40)])
def test_the_gain_of_a_patch_is_what_painting_it_saves(size):
    generator = np.random.default_rng(0)
    target, image, weight = generator.random((3, *size)), generator.random((3, *size)), generator.random(size)
    found = patches_of(target, np.square(target - image).sum(0), weight, 20, 0.1)
    assert len(found.gain)
    for top, bottom, left, right, gain in zip(
        found.top, found.bottom, found.left, found.right, found.gain, strict=True
    ):
        there = slice(top, bottom), slice(left, right)
        counts = weight[there]
        color = (target[:, *there] * counts).sum((1, 2)) / counts.sum()
        before = (np.square(target - image).sum(0) * weight)[there].sum()
        after = (np.square(target[:, *there] - color[:, None, None]).sum(0) * counts).sum()
        assert gain == pytest.approx(before - after, abs=1e-6)


def test_proposals_lie_where_the_error_is_at_its_scale_and_the_best_comes_first():
    target = torch.full((3, 60, 60), 0.5)
    target[:, 10:40, 5:35] = 0.9
    target[0, 50:53, 40:58] = 0.0
    new, gain = proposals(state_of(torch.full_like(target, 0.5), target), 9, 0.0)
    check_strokes(new)
    assert (gain.diff() <= 0).all()
    assert (new.position[0] - torch.tensor([20.0, 25.0])).norm() < 8
    on_the_bar = (new.position - torch.tensor([49.0, 51.5])).norm(dim=1) < 6
    thickness = new.width * new.scale
    assert (thickness[0] > 4 * thickness[on_the_bar]).any()
    nothing, _ = proposals(state_of(target, target), 5, 0.0)
    assert len(nothing) == 0


@pytest.mark.parametrize("size", [(1, 1), (1, 9), (2, 2), (5, 3)])
def test_proposals_for_the_smallest_pictures_are_strokes(size):
    new, gain = proposals(state_of(torch.zeros(3, *size), torch.rand(3, *size)), 50, 0.0)
    check_strokes(new)
    assert len(new) == len(gain) <= size[0] * size[1]


def test_the_number_of_strokes_follows_the_scene_and_the_price():
    generator = torch.Generator().manual_seed(0)
    busy = torch.nn.functional.interpolate(torch.rand(1, 3, 10, 14, generator=generator), SIZE)[0]
    simple, dear, cheap = (
        painted(Worth(price=price), target=target) for target, price in ((emblem(), 4e-3), (busy, 2e-2), (busy, 4e-3))
    )
    counts = [len(painter.catalogue) for painter in (simple, dear, cheap)]
    assert counts[0] < counts[2]
    assert counts[1] < counts[2]
    assert error_of(cheap) < error_of(dear)


@pytest.mark.parametrize(("price", "n"), [(math.inf, 1), (0.0, 40)])
def test_for_an_infinite_price_one_stroke_stays_and_for_none_as_many_as_there_may_be(price, n):
    painter = painted(Worth(price=price), target=torch.rand(3, *SIZE), budget=40)
    assert len(painter.catalogue) == n
    assert math.isfinite(error_of(painter))


@pytest.mark.parametrize("size", [(1, 1), (24, 24)])
def test_a_flat_picture_needs_one_stroke(size):
    painter = painted(Worth(), target=BACKGROUND[:, None, None].expand(3, *size), budget=9, steps=40)
    assert len(painter.catalogue) == 1
    assert "1 stroke:" in painter.components.density.findings()["verdict"]


def test_a_wanted_psnr_is_reached_with_few_strokes_and_the_verdict_says_so():
    density = Worth()
    painter = painted(density, psnr=27.0, steps=120)
    found, reached = density.findings(), psnr_of(error_of(painter))
    assert 27 <= reached < 29
    assert found["strokes_needed"] == len(painter.catalogue) <= 10
    assert "the fewest found for psnr=27" in density.findings()["verdict"]
    counts, decibels = zip(*found["strokes_psnr"], strict=True)
    assert sorted(counts) == list(counts)
    assert sorted(decibels) == list(decibels)
    assert painter.schedule.steps <= 2 * 120


def test_a_trial_with_fewer_strokes_that_fails_brings_back_the_best_in_their_order():
    density, target, strokes = Worth(), torch.full((3, 24, 24), 0.5), random_strokes(20, (24, 24))
    matter, order = torch.arange(20.0).flip(0), torch.arange(20).roll(7)
    good, bad = torch.full_like(target, 0.501), torch.zeros_like(target)
    about = {"psnr": 30.0, "step": 60, "steps": 60}
    density._limit, density._grown = 120, 30
    first = density.revise(
        state_of(good, target, strokes=strokes, importance=lambda: matter, front_to_back=order, **about)
    )
    assert first.keep.tolist() == [True] * 18 + [False] * 2, "the least important tenth goes for trial"
    assert first.steps == 120
    about |= {"step": 120, "steps": 120}
    density.load_state_dict(density.state_dict())  # as when an interrupted run continues
    second = density.revise(state_of(bad, target, strokes=strokes[first.keep], **about))
    upward = order.flip(0)
    assert not second.keep.any()
    assert torch.equal(second.new.position, strokes.position[upward[upward != 19]]), "half as many are left out"
    about |= {"step": second.steps, "steps": second.steps}
    third = density.revise(state_of(bad, target, strokes=second.new, **about))
    assert torch.equal(third.new.position, strokes.position[upward[upward != 18]]), "then another one"
    about |= {"step": third.steps, "steps": third.steps}
    last = density.revise(state_of(bad, target, strokes=third.new, **about))
    assert not last.keep.any()
    assert last.steps is None, "twice the planned steps are over"
    assert torch.equal(last.new.position, strokes.position[upward])


def test_a_psnr_that_cannot_be_reached_ends_at_the_limits_and_says_what_was_reached():
    density = Worth()
    painter = painted(density, target=torch.rand(3, 24, 24), psnr=99.0, budget=30, steps=40)
    assert len(painter.catalogue) == 30
    assert f"only {psnr_of(error_of(painter)):.2f} dB, within max_strokes=30" in density.findings()["verdict"]
    assert painter.schedule.steps <= 80


def test_seconds_decide_the_number_of_steps_where_they_are_set():
    painter = painted(Worth(), psnr=25.0, is_timed=True, steps=80)
    assert painter.schedule.steps == 80


def test_an_interrupted_painting_goes_on_as_if_nothing_had_been(tmp_path):
    assert_resumes(lambda: painter_of(Worth(), steps=50, psnr=26.0), 35, tmp_path)


def test_few_steps_add_no_strokes_and_a_line_says_so():
    assert "it adds strokes with steps=20 or more" in Worth().idle_reason(5)
    assert Worth().idle_reason(20) == ""
    alone = state_of(torch.zeros(3, 8, 8), torch.ones(3, 8, 8), strokes=Strokes.none(), step=10)
    assert len(Worth().revise(replace(alone, budget=9)).keep) == 0


@pytest.mark.parametrize(("word", "meaning", "price"), [
    ("strokes=auto", "density=worth", 1e-3),
    ("worth=sketch", "density=worth_sketch", 4e-3),
    ("worth=normal", "density=worth", 1e-3),
    ("worth=fine", "density=worth_fine", 2.5e-4),
])  # fmt: skip
def test_words_for_the_price(word, meaning, price):
    assert meaning_of(word) == meaning
    cfg = configured([meaning])
    assert cfg.density["_target_"] == "density/worth"
    assert cfg.density.price == price


def test_strokes_auto_may_stand_beside_its_price():
    expanded = expand_arguments(["look=plain", "strokes=auto", "worth=fine"])
    assert "density=worth_fine" in expanded
    assert "density=worth" not in expanded


@pytest.mark.parametrize(("words", "budget", "first"), [
    ([], 96, 16), (["max_strokes=20"], 20, 12), (["strokes=30"], 30, 16), (["steps=500"], 96, 4),
])  # fmt: skip
def test_the_largest_number_is_typed_or_follows_from_the_pixels(words, budget, first):
    painter = build_painter(configured(["density=worth", "psnr=30", "faces=off", *words]), torch.rand(3, 32, 48))
    assert (painter.budget, len(painter.catalogue), painter.wanted_psnr) == (budget, first, 30)


def test_the_page_shows_the_curve_by_strokes_and_says_where_it_ended():
    charts = _curves({}, {"strokes_psnr": [[10, 20.0], [20, 25.0], [120, 26.0]], "verdict": "20 strokes: enough"})
    assert [(chart["title"], chart["x"], chart["note"]) for chart in charts] == [
        ("PSNR by strokes, dB", [10, 20, 120], "20 strokes: enough")
    ]
    assert _curves({}, {"strokes_psnr": [[1, 20.0]], "verdict": "1 stroke"}) == []


def test_a_few_strokes_grow_on_a_smaller_picture_and_the_last_steps_see_all_of_it():
    painter, seen = painter_of(Worth(), target=emblem((200, 260)), steps=150, budget=4000), []
    revise = painter.components.density.revise

    def look(state):
        seen.append(state)
        assert state.image.shape == state.target.shape
        assert state.strokes.position[:, 0].max() < 1.2 * state.target.shape[2]
        return revise(state)

    painter.components.density.revise = look
    loop = None
    while painter.schedule.step < painter.schedule.steps:
        assert painter.is_unready == (painter.zoom_of_step < 1)
        loop = take(painter, 1, loop)
    assert seen[0].target.shape == (3, 100, 130)
    assert seen[-1].target.shape == (3, 200, 260)
    assert psnr_of(error_of(painter)) > 26


def test_importance_and_new_strokes_of_a_smaller_picture_are_those_of_the_painting():
    painter = painter_of(Worth(), target=emblem((200, 260)), n=12)
    painter.prepare()
    take(painter, 1)
    whole, small = painter._state_for_policy(painter.draw_whole()), painter._state_for_policy(painter.latest(0.5), 0.5)
    torch.testing.assert_close(small.strokes.position * 2, whole.strokes.position)
    assert float(4 * small.importance().sum() / whole.importance().sum()) == pytest.approx(1, rel=0.1)
    before = len(painter.catalogue)
    painter._densify(painter.configure_optimizers()["optimizer"], 0.5)
    added = painter.strokes()[before:]
    assert len(added)
    assert added.position[:, 0].max() > 130, "beyond the width of the smaller picture"


def test_the_picture_is_halved_only_if_it_leaves_room_for_each_stroke():
    density = Worth()
    paintings = [(9, (512, 512)), (500, (512, 512)), (5000, (512, 512)), (9, (96, 900))]
    sizes = [density.zoom(n, size, None) for n, size in paintings]
    assert sizes == [0.25, 0.5, 1.0, 1.0]
    assert density.zoom(9, (512, 512), 30.0) == 1, "a goal is one of the whole picture"
    density._grown = 10
    assert density.zoom(9, (512, 512), None) == 1


def test_steps_end_when_a_round_of_them_does_not_pay():
    target, density = torch.full((3, 24, 24), 0.5), Worth()
    density._limit, density._grown = 400, 100
    about = {"steps": 300, "importance": lambda: torch.ones(3), "strokes": random_strokes(3, (24, 24))}

    def after(step, error):
        return density.revise(state_of(target + error, target, step=step, **about))

    assert after(120, 0.4).steps is None
    assert after(140, 0.4).steps is None, "no better, but the learning rate is still high"
    assert after(220, 0.3).steps is None
    assert after(240, 0.2999).steps == 240
    timed = density.revise(state_of(target + 0.3, target, step=260, may_replan=False, **about))
    assert timed.steps is None, "seconds decide"
