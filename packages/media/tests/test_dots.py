"""Test that dots divide a picture's hues and preserve its lightness and mean colour."""

import numpy as np
import pytest
import torch
from brushexp_media.init.dots import UNEVEN
from torch.testing import assert_close

from brushexp.pictures.color import to_lab
from brushexp.registry import build_named

GREY, SKIN, LEAVES = (0.5, 0.5, 0.5), (0.75, 0.6, 0.5), (0.3, 0.45, 0.25)


def dots_of(target, n=600, **options):
    return build_named("init", "dots", options)(target, n, torch.Generator().manual_seed(0))


def even(color):
    return torch.tensor(color)[:, None, None].expand(3, 60, 60).contiguous()


@pytest.mark.parametrize("color", [GREY, SKIN, LEAVES])
def test_dots_go_apart_in_hue_and_keep_lightness_and_about_their_mean(color):
    assert_close(dots_of(even(color), division=0.0).color, torch.tensor([color]).expand(600, 3), atol=1e-5, rtol=0)
    lab = to_lab(dots_of(even(color), division=0.3).color.double().numpy())
    own = to_lab(np.array([color]))
    assert np.hypot(*(lab - own)[:, 1:].T).mean() > 10
    assert (lab - own)[:, 0].std() < 2 * 30 * UNEVEN
    assert np.abs((lab - own).mean(0)).max() < 10  # the optimiser corrects the rest


def test_greys_are_orange_and_blue():
    lab = to_lab(dots_of(even(GREY), division=0.3).color.double().numpy())
    warm = lab[:, 2] > 0
    assert 0.3 < warm.mean() < 0.7
    assert np.abs(np.corrcoef(lab[:, 1], lab[:, 2])[0, 1]) > 0.2


def test_some_dots_have_the_opposite_hue_and_most_a_purer_one():
    own = to_lab(np.array([LEAVES]))[0, 1:]
    lab = to_lab(dots_of(even(LEAVES), division=0.15).color.double().numpy())
    along = lab[:, 1:] @ own / np.square(own).sum()
    assert 0.5 < (along > 1.05).mean() < 0.9
    assert 0.05 < (along < 0.9).mean() < 0.4


def test_touches_below_the_dots_hide_the_ground_and_are_duller_and_in_shadow_cooler():
    target = torch.cat([torch.full((3, 60, 20), tone) for tone in (0.2, 0.68, 0.97)], 2)
    below = dots_of(target, under=0.2)[:120]
    assert bool((below.opacity > 0).all())
    column = (below.position[:, 0] / 20).long().clamp(0, 2)
    dark, middle, white = (to_lab(below.color[column == number].double().numpy()) for number in range(3))
    assert np.median(dark[:, 0]) < to_lab(np.array([[0.2] * 3]))[0, 0]
    assert np.median(dark[:, 2]) < -5  # cooler
    assert np.median(middle[:, 0]) < to_lab(np.array([[0.68] * 3]))[0, 0]
    assert np.median(white[:, 0]) == pytest.approx(to_lab(np.array([[0.97] * 3]))[0, 0], abs=1)


def test_hues_of_small_dots_and_in_the_focus_go_apart_less():
    target, focus = torch.full((3, 60, 60), 0.5), torch.full((60, 60), 0.5)
    focus[30:] = 9
    dots = build_named("init", "dots", {"layers": 1})(target, 600, torch.Generator().manual_seed(0), focus)
    chroma = np.hypot(*to_lab(dots.color.double().numpy())[:, 1:].T)
    below = (dots.position[:, 1] > 32).numpy()
    assert chroma[below].mean() < 0.6 * chroma[~below].mean()
    target[:, :30, ::4] = 0.6
    dots = dots_of(target, layers=2, ratio=0.5, cover=0.3)
    size = (dots.width * dots.scale).numpy()
    chroma = np.hypot(*to_lab(dots.color.double().numpy())[:, 1:].T)
    assert chroma[size < 0.7 * size.max()].mean() < 0.8 * chroma[size > 0.7 * size.max()].mean()


def test_dots_have_one_size_where_layers_have():
    dots = dots_of(torch.rand(3, 60, 60), layers=2, ratio=1.0)
    assert float((dots.width * dots.scale).std()) < 1e-3
