"""Test that the ground changes colour at each step, but has the painting's own colour whenever the picture is shown."""

import torch
from brushexp_changes.random_ground import RandomGround, random_color
from brushexp_policies.patches import Patches
from painters import painter_of, take
from refusals import refuses

from brushexp.config.check import check
from brushexp.plugins.change.base import Change


class Watch(Change):
    """Change that only records the ground of each step."""

    def __init__(self):
        self.grounds = []

    def aim(self, target, ground, state):
        self.grounds.append(ground)
        return target, ground


def grounds_of(change, steps=10, **parts):
    """Run optimisation steps; return the painting's own ground and the ground of each step."""
    watch = Watch()
    painter = painter_of(steps=steps, options={"changes": {"random_ground": change, "watch": watch}}, **parts)
    loop, own = None, painter.picture.background
    for _ in range(steps):
        loop = take(painter, 1, loop)
        assert painter.picture.background is own
    return own, watch.grounds


def test_the_ground_changes_with_the_step_and_is_its_own_when_the_picture_is_shown():
    own, grounds = grounds_of(RandomGround(until=0.5))
    assert len({tuple(ground.tolist()) for ground in grounds}) == 6
    assert torch.equal(grounds[3], random_color(own, 3)), "a resumed run draws the same colour"
    assert all(ground is own for ground in grounds[5:])


def test_the_ground_stays_while_a_part_is_looked_at():
    own, grounds = grounds_of(RandomGround(), steps=3, sampler=Patches())
    assert all(ground is own for ground in grounds)


def test_a_painter_without_steps_is_refused(config):
    words = ["chelsea", "change=random_ground", "painter=hertzmann"]
    refuses("change=random_ground is for painter=gradient, not hertzmann; drop painter", check, config(*words), words)
