"""Test that wet strokes drag paint along, and that optimising for the wet painting brings it closer to the target."""

from dataclasses import replace

import pytest
import torch
from brushexp_changes.wet.dragging import drag_paint, sample_under_starts
from brushexp_changes.wet.wet import Wet
from painters import SIZE, assert_resumes, fit, painter_of
from refusals import refuses
from scenes import straight
from torch.nn.functional import interpolate

import brushexp
from brushexp.config.check import check
from brushexp.plugins.change.base import Change
from brushexp.plugins.order.fixed import FixedOrder
from brushexp.strokes.catalogue import Strokes

AMOUNT = 0.8


@pytest.mark.parametrize("widening", [0.0, 0.9])
def test_wet_strokes_drag_what_lies_under_their_starts(widening):
    below = straight((2, 20), (38, 20), width=30.0, color=(0.9, 0.1, 0.1), opacity=1.0)
    above = straight((30, 20), (70, 20), width=10.0, color=(0.1, 0.2, 0.9), opacity=1.0)
    above = replace(above, widening=torch.tensor([widening]))
    away = straight((-30, 10), (-10, 10), color=(0.0, 1.0, 0.0))
    strokes = Strokes.join(below, above, away)
    painter = painter_of(steps=0, order=FixedOrder(), strokes=strokes, target=torch.zeros(3, 40, 80))
    dry, order, state = painter.strokes(), painter.front_to_back, painter.now()
    picked, covered = sample_under_starts(dry, order, state)
    torch.testing.assert_close(covered, torch.tensor([0.0, 1.0, 0.0]))
    torch.testing.assert_close(picked[1], below.color[0])
    assert drag_paint(dry, order, state, 0.0) == (dry, order)
    strokes, wet_order = drag_paint(dry, order, state, 1.0)
    assert len(strokes) == 3 + 4, "a bare canvas is dry"
    torch.testing.assert_close(strokes[:3].color, dry.color)
    assert torch.equal(strokes.brush[:3], dry.brush)
    assert set(strokes.brush[3:].tolist()) < set(dry.brush.tolist()), "a film has the same bristles as its stroke"
    before, after = painter.picture.draw(dry, order), painter.picture.draw(strokes, wet_order)
    reds = after[0, 20, [34, 46, 58, 68]]
    assert (reds[:-1] > reds[1:] + 0.02).all(), "the red runs out along the blue stroke"
    torch.testing.assert_close(after[:, 20, 76], before[:, 20, 76])
    assert torch.equal(after[:, :12, :52], before[:, :12, :52]), "a film is no thicker than its stroke"


def painter(steps=100, **changes):
    noise = torch.rand(1, 3, 4, 6, generator=torch.Generator().manual_seed(2))
    target = interpolate(noise, SIZE, mode="bicubic")[0].clamp(0, 1)
    return painter_of(steps=steps, n=150, target=target, options={"changes": changes})


def wet_error(one):
    wet = drag_paint(one.strokes(), one.front_to_back, one.now(), AMOUNT)
    return (one.picture.draw(*wet) - one.picture.own_target).square().mean().item()


def test_the_wet_painting_is_nearer_to_the_target():
    blind, knowing = painter(wet=Wet(amount=AMOUNT)), painter(wet=Wet(amount=AMOUNT, every=5))
    fit(blind)
    fit(knowing)
    assert wet_error(knowing) < 0.8 * wet_error(blind)
    knowing.hand_over()
    assert knowing.picture.target is knowing.picture.own_target
    assert len(knowing.finished_strokes()[0]) > len(knowing.strokes()) == 150


class Watch(Change):
    """Change that only records the target of each step."""

    def __init__(self):
        self.targets = []

    def aim(self, target, ground, state):
        self.targets.append(target)
        return target, ground


def test_the_first_look_comes_late_and_moves_the_target_by_what_wet_paint_lacks():
    watch = Watch()
    one = painter(20, wet=Wet(amount=AMOUNT, every=5, after=0.3), watch=watch)
    fit(one)
    moved = [target is not one.picture.own_target for target in watch.targets]
    assert moved == [False] * 10 + [True] * 10
    assert watch.targets[10] is watch.targets[13]
    assert watch.targets[10] is not watch.targets[15]


def test_an_interrupted_fit_ends_as_one_that_is_not(tmp_path):
    assert_resumes(lambda: painter(24, wet=Wet(amount=AMOUNT, every=5)), 12, tmp_path)


def test_wet_paint_of_other_painters_is_dragged_too_and_only_steps_know_of_it(config):
    small = {"image": "chelsea", "resolution": 48, "strokes": 30, "painter": "haeberli", "threads": 1}
    dry, wet = brushexp.paint(**small), brushexp.paint(**small, wet=1)
    assert len(wet.strokes) > len(dry.strokes)
    words = ["chelsea", "wet=0.5", "change.wet.every=5", "painter=haeberli"]
    refuses(r"change\.wet\.every=5 is for painter=gradient, not haeberli", check, config(*words), words)
