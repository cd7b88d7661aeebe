"""Broken colour moves the colours of strokes after the last step, less where one looks first, and nothing else."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from brushexp_media.broken import DARKEST, FINEST
from brushexp_testing.families import some_strokes
from torch.testing import assert_close

from brushexp.pictures.color import to_lab
from brushexp.plugins.density.base import DensificationState
from brushexp.registry import build_named

N, SIZE = 400, (60, 80)


def broken(strokes, focus=None, **options):
    """The strokes after the last step, and by how much each has moved in CIELAB (N, 3)."""
    empty = torch.zeros(3, *SIZE)
    state = DensificationState(empty, empty, focus, strokes, len(strokes), 10, 10, lambda: torch.zeros(len(strokes)))
    update = build_named("density", "broken", options).revise(state)
    assert not update.keep.any()
    before, after = (to_lab(each.color.double().numpy()) for each in (strokes, update.new))
    return update.new, after - before


def strokes_of(color, width=0.3):
    strokes = some_strokes(N, SIZE)
    return replace(
        strokes, color=torch.tensor(color).expand(N, 3), width=torch.full((N,), width), scale=torch.full((N,), 20.0)
    )


def test_colours_move_as_far_as_asked_and_nothing_else_does():
    strokes = strokes_of((0.6, 0.5, 0.4))
    moved, shift = broken(strokes, lightness=4.0, chroma=10.0)
    length = np.hypot(*shift[:, 1:].T)
    assert np.abs(shift[:, 0]).max() == pytest.approx(4, abs=0.2)
    assert length.max() == pytest.approx(10, abs=0.4)
    assert np.abs(shift.mean(0)).max() < 0.6  # the mean is that of the picture
    assert_close(dict(replace(moved, color=strokes.color).items()), dict(strokes.items()))
    assert torch.equal(moved.brush, strokes.brush)


def test_it_is_due_after_the_last_step_alone():
    density = build_named("density", "broken", {})
    assert [step for step in range(1, 21) if density.due(step, 20)] == [20]


def test_dark_strokes_and_fine_ones_and_those_in_the_focus_move_less():
    _, usual = broken(strokes_of((0.6, 0.5, 0.4)))
    _, dark = broken(strokes_of((0.06, 0.05, 0.05)))
    focus = torch.full(SIZE, 0.1)
    focus[:, 40:] = 4.0
    _, looked_at = broken(strokes_of((0.6, 0.5, 0.4)), focus)
    right = (strokes_of((0.6, 0.5, 0.4)).position[:, 0] > 41).numpy()
    assert np.abs(dark[:, 0]).mean() == pytest.approx(DARKEST * np.abs(usual[:, 0]).mean(), rel=0.2)
    assert_close(looked_at[right], 0.5 * usual[right], atol=0.2, rtol=0)
    width = torch.full((N,), 0.3)
    width[::4] = 0.01
    _, finer = broken(replace(strokes_of((0.6, 0.5, 0.4)), width=width))
    assert_close(finer[::4], FINEST * usual[::4], atol=0.2, rtol=0)


def test_the_same_seed_breaks_alike_and_another_does_not():
    strokes = strokes_of((0.6, 0.5, 0.4))
    one, again, other = (broken(strokes, seed=seed)[0].color for seed in (1, 1, 2))
    assert torch.equal(one, again)
    assert not torch.equal(one, other)
