"""Dots divide the hue of a picture, and keep its lightness and its mean."""

import numpy as np
import pytest
import torch
from brushexp_media.dots import UNEVEN
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
    assert np.abs((lab - own).mean(0)).max() < 10  # the optimiser mends the rest


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
    assert 0.05 < (along < 0.7).mean() < 0.4


def test_dots_have_one_size_where_layers_have():
    dots = dots_of(torch.rand(3, 60, 60), layers=2, ratio=1.0)
    assert float((dots.width * dots.scale).std()) < 1e-3
