"""Tests of variety: finished strokes turn warmer or cooler with their lightness and by chance; only colours change."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from painters import SIZE, painter_of
from scenes import random_strokes
from torch.testing import assert_close

import brushexp
from brushexp.pictures.color import to_lab
from brushexp.plugins.change.variety import MOST_TURN, Variety
from brushexp.plugins.renderer.textured import Textured
from brushexp.strokes.catalogue import Strokes
from brushexp.strokes.storage import load_catalogue


def broken(strokes, target, amount=0.5, seed=0, focus=None):
    """Return the strokes' colours after `Variety` has varied them, and check that nothing else has changed."""
    painter = painter_of(target=target, options={"focus": focus})
    state = replace(painter.now(), generator=torch.Generator().manual_seed(seed))
    order = torch.arange(len(strokes))
    ended, same = Variety(amount=amount).end(strokes, order, state)
    assert same is order
    assert all(value is getattr(strokes, name) for name, value in ended.items() if name != "color")
    return ended.color


def strokes_in(color, n=400):
    strokes = random_strokes(n, SIZE)
    return replace(strokes, color=torch.tensor(color).expand(n, 3).clone(), width=torch.full((n,), 0.2))


def lab_of(colors):
    return to_lab(colors.double().numpy())


def even(color):
    return torch.tensor(color)[:, None, None].expand(3, *SIZE)


def test_none_is_none_and_seeds_decide_the_rest():
    strokes, target = random_strokes(30, SIZE), torch.rand(3, *SIZE)
    assert broken(strokes, target, amount=0.0) is strokes.color
    assert broken(Strokes.none(), target).shape == (0, 3)
    assert torch.equal(broken(strokes, target), broken(strokes, target))
    assert not torch.equal(broken(strokes, target), broken(strokes, target, seed=1))


def test_what_is_lighter_than_around_it_becomes_warmer_and_what_is_darker_cooler():
    light, middle, dark = (lab_of(broken(strokes_in([grey] * 3), even([0.5] * 3))).mean(0) for grey in (0.6, 0.5, 0.4))
    assert light[2] > middle[2] + 2
    assert middle[2] > dark[2] + 2
    assert abs(middle[1]) < 1.5
    assert abs(middle[2]) < 1.5


def test_a_hue_goes_to_its_neighbours_alone():
    skin = [0.8, 0.6, 0.5]
    before, after = lab_of(torch.tensor([skin])), lab_of(broken(strokes_in(skin), even(skin), amount=1.0))
    turned = np.abs(np.angle(np.exp(1j * (np.arctan2(*after.T[:0:-1]) - np.arctan2(*before.T[:0:-1])))))
    assert turned.max() < np.arctan(2.2 * MOST_TURN)  # in sRGB, after rounding and with less chroma
    assert turned.std() > 0.1


def test_details_darks_and_what_one_looks_at_first_differ_less():
    grey, target = strokes_in([0.5] * 3), even([0.5] * 3)
    fine = replace(grey, width=torch.where(torch.arange(400) < 200, 0.02, 0.2))
    away = np.abs(lab_of(broken(fine, target)) - lab_of(grey.color)).mean(1)
    assert away[:200].mean() < 0.5 * away[200:].mean()
    dark = strokes_in([0.08] * 3)
    darks = np.abs(lab_of(broken(dark, even([0.08] * 3))) - lab_of(dark.color)).mean()
    assert darks < 0.7 * np.abs(lab_of(broken(grey, target)) - lab_of(grey.color)).mean()
    focus = torch.full(SIZE, 0.5)
    focus[:, SIZE[1] // 2 :] = 4.0
    away = np.abs(lab_of(broken(grey, target, focus=focus)) - lab_of(grey.color)).mean(1)
    right = (grey.position[:, 0] > 0.7 * SIZE[1]).numpy()
    assert away[right].mean() < 0.6 * away[(grey.position[:, 0] < 0.3 * SIZE[1]).numpy()].mean()


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize("size", [(1, 1), (1, 300), SIZE])
def test_extremes_stay_colours(dtype, size):
    strokes = random_strokes(5, SIZE).map(lambda value: value.to(dtype))
    colors = torch.tensor([[0.0] * 3, [1.0] * 3, [1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.5] * 3], dtype=dtype)
    far = replace(strokes, color=colors, position=1e6 * strokes.position.sign(), width=strokes.width * 0)
    for some in (replace(strokes, color=colors), far, far[:1]):
        result = broken(some, torch.rand(3, *size), amount=1.0)
        assert result.dtype == dtype
        assert bool(((result >= 0) & (result <= 1)).all())


def test_a_run_breaks_colours_at_its_end_and_keeps_those_of_a_painting_that_stays(tmp_path):
    painters = [painter_of(steps=0, options={"changes": {"variety": Variety(amount=amount)}}) for amount in (0.0, 0.7)]
    plain, varied = (dict(painter.finished_strokes()[0].items()) for painter in painters)
    assert not torch.equal(plain.pop("color"), varied.pop("color"))
    assert_close(plain, varied, rtol=0, atol=0)
    small = {"image": "astronaut", "resolution": 48, "strokes": 40, "steps": 2, "threads": 1, "density": "fixed"}
    first = brushexp.paint(**small, variety=0.7)
    first.save(tmp_path / "first")
    again = brushexp.paint(**small | {"steps": 0, "order": "fixed"}, catalogue=str(tmp_path / "first"), variety=0.7)
    saved = load_catalogue(tmp_path / "first" / "catalogue.h5")
    kept = saved.strokes[saved.depth.argsort()]
    assert torch.equal(again.strokes[again.depth.argsort()].color, kept.color)


def test_a_full_brush_covers_as_several_strokes_do():
    strokes = replace(random_strokes(1, SIZE), opacity=torch.ones(1))
    points = torch.rand(1, 200, 2) * torch.tensor([SIZE[1], SIZE[0]])
    once, thrice = (
        Textured(fullness=k).train()(strokes).sample(torch.zeros(1, 1, dtype=torch.long), points)[0] for k in (1, 3)
    )
    assert once.max() > 0.5
    away = thrice - (1 - (1 - once) ** 3)  # between texels it is not an exact power
    assert away.abs().mean() < 0.01
    assert (thrice - once).min() > -1e-6


def test_a_goal_of_steps_is_told_from_what_a_painting_has(caplog):
    small = {"image": "astronaut", "resolution": 48, "strokes": 40, "threads": 1}
    brushexp.paint(**small, steps=3, psnr=5)
    assert "psnr=5 is the goal of the steps, and variety=0.55 lowers it afterwards; variety=0 keeps it" in caplog.text
    caplog.clear()
    brushexp.paint(**small, steps=3, psnr=5, variety=0)
    assert "variety" not in caplog.text
