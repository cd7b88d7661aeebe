"""Steps that know of wet paint: the wet painting is nearer to the target, and nothing is left behind."""

from functools import partial
from pathlib import Path

import pytest
import torch
from brushexp_media.wet_steps import WetSteps
from brushexp_media.wet_target import WetTarget
from painters import SIZE, fit, painter_of
from torch.nn.functional import interpolate
from torch.testing import assert_close

from brushexp.errors import UserError
from brushexp.painting.wet import drag_paint

WET = 0.8
opened = partial(WetSteps(every=5, wet=WET).open, Path())


def painter(steps=100):
    noise = torch.rand(1, 3, 4, 6, generator=torch.Generator().manual_seed(2))
    target = interpolate(noise, SIZE, mode="bicubic")[0].clamp(0, 1)
    return painter_of(steps=steps, n=150, target=target)


def wet_error(one):
    return (one.picture.draw(*drag_paint(one, WET)) - one.pictures["target"]).square().mean().item()


def test_the_wet_painting_is_nearer_to_the_target():
    blind, knowing = painter(), painter()
    fit(blind)
    fit(knowing, [opened()])
    assert wet_error(knowing) < 0.8 * wet_error(blind)
    assert torch.equal(knowing.picture.target, knowing.pictures["target"])


def test_the_first_look_comes_late_and_moves_the_target_by_what_wet_paint_lacks():
    one, seen = painter(20), []

    class Watch(type(opened())):
        def on_train_batch_end(self, trainer, module, *_):
            super().on_train_batch_end(trainer, module)
            seen.append(module.picture.target)

    fit(one, [Watch(every=5, after=0.3, wet=WET)])
    moved = [not torch.equal(target, one.pictures["target"]) for target in seen]
    assert moved == [False] * 9 + [True] * 11
    assert seen[9] is seen[12]
    assert seen[9] is not seen[14]


def test_an_interrupted_fit_ends_as_one_that_is_not(tmp_path):
    straight, first, second = (painter(24) for _ in range(3))
    fit(straight, [opened()])
    fit(first, [opened()], max_steps=12).save_checkpoint(tmp_path / "it.ckpt")
    fit(second, [opened()], ckpt_path=tmp_path / "it.ckpt")
    assert_close(dict(straight.strokes().items()), dict(second.strokes().items()), rtol=0, atol=0)


def test_dry_paint_is_refused(tmp_path):
    with pytest.raises(UserError, match=r"add wet=0\.5"):
        fit(painter(2), [WetSteps().open(tmp_path)])
    with pytest.raises(UserError, match="painter=gradient"):
        WetTarget(5, 0.0, WET).setup(None, torch.nn.Linear(1, 1), "fit")
