"""Test that stroke thickness stays between the smallest and the largest brush at every step."""

from dataclasses import replace

import pytest
import torch
from brushexp_changes.sizes import Sizes
from painters import SIZE, fit, painter_of
from refusals import refuses
from torch.testing import assert_close

from brushexp.config.check import check
from brushexp.errors import UserError
from brushexp.plugins.change.base import Change
from brushexp.plugins.optimizer.torch import UNITS, TorchOptim
from brushexp.strokes.bezier import half_width_of

RED = torch.tensor([1.0, 0.0, 0.0])


def painter(steps=12, **changes):
    optimizer = TorchOptim(lr=0.05, units=UNITS | {"widening": 0.3})
    return painter_of(steps=steps, optimizer=optimizer, options={"changes": changes})


def thickness(strokes):
    return 2 * half_width_of(strokes)


class Watch(Change):
    """Change that only records the strokes after each step."""

    def __init__(self):
        self.seen = []

    def limit(self, strokes, before, rows, state):
        if before is not None:
            self.seen.append(strokes)
        return strokes


class Reds(Change):
    """Change that makes all strokes red."""

    def limit(self, strokes, before, rows, state):
        return replace(strokes, color=RED.expand_as(strokes.color))


def test_strokes_stay_within_the_bounds_at_every_step_and_are_optimised_for_them():
    free = painter()
    fit(free)
    assert thickness(free.strokes()).min() < 3
    assert thickness(free.strokes()).max() > 5
    watch = Watch()
    bound = painter(sizes=Sizes(smallest="3", largest="5px"), watch=watch)
    assert 3 - 1e-4 < thickness(bound.catalogue()).min() <= thickness(bound.catalogue()).max() < 5 + 1e-4
    fit(bound)
    assert len(watch.seen) == 12
    for strokes in [*watch.seen, bound.strokes()]:
        ends = thickness(strokes)[:, None] * (1 + strokes.widening[:, None] * torch.tensor([-1.0, 1.0]))
        assert 3 - 1e-4 < ends.min() <= ends.max() < 5 + 1e-4
    assert watch.seen[-1].widening.abs().max() > 0.01
    afterwards = free.strokes()
    free.catalogue.replace(Sizes(smallest="3", largest="5").within(afterwards, SIZE[1]))
    error = [(one.draw_whole() - one.picture.target).square().mean() for one in (bound, free)]
    assert error[0] < error[1]


def test_millimetres_are_those_of_the_painting_and_what_is_no_size_or_has_no_strokes_is_refused(config):
    assert Sizes(smallest="2mm", largest="10mm", width_cm=7.0).bounds(140) == (4, 20)
    assert Sizes(largest="3").bounds(140) == (0, 3)
    with pytest.raises(UserError, match="smallest=2mm is above largest=2;"):
        Sizes(smallest="2mm", largest="2", width_cm=7.0).bounds(140)
    refuses(r"smallest=2mm is above largest=\.5mm", Sizes, smallest="2mm", largest=".5mm")
    for words, message in (
        (["smallest=3cm"], r"^smallest=3cm is not a size; give pixels, smallest=3, or millimetres, smallest=2mm$"),
        (["smallest=3", "largest=1mm", "resolution=64"], "^smallest=3 is above largest=1mm; exchange them"),
        (["largest=3", "painter=hertzmann"], "largest=3 is for painter=gradient, not hertzmann; drop painter"),
    ):
        refuses(message, check, config("chelsea", *words), words)


def test_other_limits_bind_too_and_strokes_within_bounds_stay_to_the_bit():
    one = painter(steps=3, reds=Reds(), sizes=Sizes(smallest="2"))
    fit(one)
    assert (one.strokes().color == RED).all()
    assert thickness(one.strokes()).min() > 2 - 1e-4
    strokes = painter().strokes()
    assert_close(dict(Sizes().within(strokes, 70).items()), dict(strokes.items()), rtol=0, atol=0)
