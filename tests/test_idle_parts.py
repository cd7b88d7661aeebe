"""Tests that the parts that have no effect on a painting, and only those, are reported, each in one line."""

import pytest
import torch
from brushexp_policies.patches import Patches

from brushexp.painting.components import Stage, standard_components
from brushexp.painting.idle_parts import log_idle_parts
from brushexp.plugins.density.adaptive import Adaptive
from brushexp.plugins.init.random import Random
from brushexp.plugins.renderer.analytic import Analytic

SIZE = (48, 64)
STROKES = Random()(torch.rand(3, *SIZE), 60, torch.Generator().manual_seed(0))


@pytest.mark.parametrize(("chosen", "steps", "told"), [
    ({"density": Adaptive()}, 5, "density=adaptive adds and removes no strokes in 5 steps; it needs steps=11 or more"),
    ({"density": Adaptive()}, 11, None),
    ({"density": Adaptive(until=0)}, 500, "density=adaptive adds and removes no strokes with density.until=0"),
    ({"sampler": Patches()}, 5, "sampler=patches moves all 60 strokes at each step, like sampler=whole"),
    ({"sampler": Patches(n_active=20)}, 5, None),
    ({"sampler": Patches(coverage="random")}, 5, "sampler=patches moves all 60 strokes"),
    ({}, 5, None),
    ({"density": Adaptive(), "sampler": Patches()}, 0, None),
])  # fmt: skip
def test_a_part_that_changes_nothing_is_told(caplog, chosen, steps, told):
    log_idle_parts(standard_components(steps=steps, **chosen), STROKES, SIZE)
    assert len(caplog.messages) == (told is not None)
    assert told is None or told in caplog.messages[0]


@pytest.mark.parametrize(("steps", "is_told"), [(5, True), (500, False)])
def test_steps_that_nobody_typed_are_told(caplog, steps, is_told):
    stages = [Stage("textured", Analytic(), steps), Stage("neural", Analytic(), 40)]
    log_idle_parts(standard_components(stages=stages), STROKES, SIZE)
    told = "5 steps with renderer=textured and then 40 with renderer=neural, 45 in total; for fewer: finish_steps=2"
    assert caplog.messages == [told] * is_told


def test_adaptive_changes_strokes_from_the_number_of_steps_on_that_is_told():
    policy = Adaptive()
    assert [policy.first(100, steps) for steps in (10, 11)] == [100, 70]
    assert [bool(policy.idle_reason(steps)) for steps in (10, 11)] == [True, False]
