"""The smallest and the largest stroke bind from the first step to the last, and the others make up for them."""

from pathlib import Path

import pytest
import torch
from brushexp_policies.sizes import Sizes
from painters import SIZE, fit, painter_of
from torch.testing import assert_close

from brushexp.config.check import check
from brushexp.errors import UserError
from brushexp.plugins.optimizer.torch import UNITS, TorchOptim
from brushexp.strokes.bezier import half_width_of

MOVING = UNITS | {"widening": 0.3}


def painter(steps=12):
    return painter_of(steps=steps, optimizer=TorchOptim(lr=0.05, units=MOVING))


def thickness(strokes):
    return 2 * half_width_of(strokes)


def test_strokes_stay_within_the_bounds_at_every_step_and_are_optimised_for_them():
    free = painter()
    fit(free)
    assert thickness(free.strokes()).min() < 3
    assert thickness(free.strokes()).max() > 5

    class Watch(type(Sizes().open(Path()))):
        def on_train_batch_end(self, trainer, module, *_):
            seen.append(module.catalogue())

    seen, bound = [], painter()
    fit(bound, [Sizes(smallest="3", largest="5px").open(Path()), Watch()])
    assert len(seen) == 12
    for strokes in [*seen, bound.strokes()]:
        ends = thickness(strokes)[:, None] * (1 + strokes.widening[:, None] * torch.tensor([-1.0, 1.0]))
        assert ends.min() > 3 - 1e-4
        assert ends.max() < 5 + 1e-4
    assert seen[-1].widening.abs().max() > 0.01
    afterwards = free.strokes()
    free.catalogue.replace(Sizes(smallest="3", largest="5").within(afterwards, SIZE[1]))
    error = [(one.draw_whole() - one.picture.target).square().mean() for one in (bound, free)]
    assert error[0] < error[1]


def test_millimetres_are_those_of_the_width_of_the_painting():
    assert Sizes(smallest="2mm", largest="10mm", width_cm=7.0).bounds(140) == (4, 20)
    assert Sizes(largest="3").bounds(140) == (0, 3)
    with pytest.raises(UserError, match="smallest=2mm is above largest=2;"):
        Sizes(smallest="2mm", largest="2", width_cm=7.0).bounds(140)
    with pytest.raises(UserError, match=r"smallest=2mm is above largest=\.5mm"):
        Sizes(smallest="2mm", largest=".5mm")


def test_other_limits_bind_too_and_strokes_within_bounds_stay_to_the_bit(tmp_path):
    one = painter(steps=3)
    red = torch.tensor([1.0, 0.0, 0.0])
    one.limit = lambda strokes, before, rows: type(strokes)(
        **dict(strokes.items()) | {"color": red.expand_as(strokes.color)}, brush=strokes.brush
    )
    fit(one, [Sizes(smallest="2").open(tmp_path)])
    assert (one.strokes().color == red).all()
    assert thickness(one.strokes()).min() > 2 - 1e-4
    strokes = painter().strokes()
    assert_close(dict(Sizes().within(strokes, 70).items()), dict(strokes.items()), rtol=0, atol=0)


def test_what_is_no_size_and_what_has_no_strokes_is_refused(config):
    words = ["chelsea", "callbacks=sizes", "callbacks.sizes.smallest=3cm"]
    with pytest.raises(UserError, match=r"smallest=3cm is no size; .*=2mm"):
        check(config(*words), words)
    with pytest.raises(UserError, match="painter=gradient"):
        Sizes().open(Path()).setup(None, torch.nn.Linear(1, 1), "fit")
