"""Growth in strata, and a ground that changes with each step."""

import pytest
import torch
from brushexp_policies.random_ground import RandomGround, random_color
from brushexp_policies.strata import Strata
from painters import take
from test_density import painter_of

from brushexp.errors import UserError
from brushexp.plugins.density.fixed import Fixed
from brushexp.plugins.sampler.base import View
from brushexp.strokes.bezier import half_width_of


def test_strokes_double_in_number_and_shrink_and_new_ones_lie_on_top():
    noise = torch.rand(1, 3, 16, 24, generator=torch.Generator().manual_seed(0))
    target = torch.nn.functional.interpolate(noise, (64, 96), mode="bicubic")[0].clamp(0, 1)
    painter = painter_of(Strata(tolerance=0.0), n=80, steps=80, target=target)
    counts, sizes = [len(painter.catalogue)], []
    for _ in range(painter.schedule.steps):
        take(painter, 1)
        if (n := len(painter.catalogue)) > counts[-1]:
            new = n - counts[-1]
            assert set(painter.front_to_back[:new].tolist()) == set(range(counts[-1], n))
            sizes.append(float(half_width_of(painter.strokes())[-new:].median()))
            counts.append(n)
    assert counts == [5, 10, 20, 40, 80]
    assert sizes == sorted(sizes, reverse=True)


def test_the_ground_changes_with_the_step_and_is_its_own_when_the_picture_is_shown():
    painter = painter_of(Fixed(), steps=10)
    own, callback, grounds = painter.picture.background, RandomGround(until=0.5).open(None), []
    view = next(iter(painter.train_dataloader()))
    for _ in range(10):
        callback.on_train_batch_start(None, painter, view, 0)
        grounds.append(painter.picture.background)
        take(painter, 1)
        callback.on_train_batch_end(None, painter, None, view, 0)
        assert painter.picture.background is own
    assert len({tuple(ground.tolist()) for ground in grounds}) == 6
    assert torch.equal(grounds[3], random_color(own, 3)), "a resumed run draws it again"
    assert all(ground is own for ground in grounds[5:])


def test_the_ground_stays_while_a_part_of_the_picture_is_looked_at():
    painter = painter_of(Fixed())
    part = View(next(iter(painter.train_dataloader())).region, torch.arange(2))
    own, callback = painter.picture.background, RandomGround().open(None)
    callback.on_train_batch_start(None, painter, part, 0)
    assert painter.picture.background is own


def test_an_error_in_a_step_leaves_the_ground_its_own_and_other_painters_are_refused():
    painter = painter_of(Fixed())
    own, callback, view = painter.picture.background, RandomGround().open(None), next(iter(painter.train_dataloader()))
    callback.on_train_batch_start(None, painter, view, 0)
    assert painter.picture.background is not own
    callback.on_exception(None, painter, ValueError())
    assert painter.picture.background is own
    with pytest.raises(UserError, match="painter=gradient"):
        callback.setup(None, torch.nn.Linear(1, 1), "fit")
