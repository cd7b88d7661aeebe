"""Test that edges formed by many strokes are smoothed along their direction without becoming less sharp."""

import numpy as np
import pytest
import torch
from brushexp_media.picture.smoothing import (
    FAINT,
    average_along,
    coherence_of_edges,
    gaussian_blur,
    luma_of,
    sharpen_edges,
    with_clean_edges,
)
from torch import Tensor
from torch.testing import assert_close

from brushexp.plugins.paper.base import Rows
from brushexp.registry import build_named


def frayed(seed: int = 0, size: int = 80) -> Tensor:
    """Draw a dark and a light half (3, size, size), separated by an edge that may shift by a pixel every third row."""
    steps = torch.randint(-1, 2, (size,), generator=torch.Generator().manual_seed(seed))
    steps = steps.repeat_interleave(3)[:size]
    dark = torch.arange(size)[None] < size // 2 + steps[:, None]
    return torch.where(dark, torch.tensor(0.2), torch.tensor(0.9)).expand(3, -1, -1).contiguous()


def test_a_frayed_edge_becomes_even_and_stays_sharp():
    picture = frayed()
    clean = with_clean_edges(picture, 2.0, 5.0)
    inner = slice(10, -10)
    places = [(0.9 - seen[0, inner]).sum(1) / 0.7 for seen in (picture, clean)]
    assert float(places[1].std()) < 0.7 * float(places[0].std())
    assert float(places[1].mean()) == pytest.approx(float(places[0].mean()), abs=0.5)
    between = ((clean[0] - 0.55).abs() < 0.25)[inner].float().sum(1)
    averaged = average_along(picture, torch.full((80, 80), torch.pi / 2), 5.0)
    assert float(between.mean()) < 0.8 * float(((averaged[0] - 0.55).abs() < 0.25)[inner].float().sum(1).mean())


def test_edges_without_a_common_direction_stay():
    dots = torch.where(torch.rand(40, 40, generator=torch.Generator().manual_seed(1)) < 0.5, 0.2, 0.9)
    picture = dots.repeat_interleave(3, 0).repeat_interleave(3, 1).expand(3, -1, -1).contiguous()
    changed = [float((with_clean_edges(seen, 2.0, 5.0) - seen).abs().mean()) for seen in (picture, frayed(size=120))]
    edges = [float((seen - seen.roll(1, 2)).abs().mean()) for seen in (picture, frayed(size=120))]
    assert changed[0] / edges[0] < 0.3 * changed[1] / edges[1]


@pytest.mark.parametrize("size", [(1, 1), (1, 9), (7, 2), (30, 40)])
def test_an_even_picture_stays(size):
    even = torch.tensor([0.2, 0.5, 0.7])[:, None, None].expand(3, *size).contiguous()
    assert_close(with_clean_edges(even, 1.2, 2.5), even)


def test_coherence_tells_stripes_from_noise():
    stripes = torch.sin(torch.arange(60) / 2).expand(3, 60, 60)
    noise = torch.rand(3, 60, 60, generator=torch.Generator().manual_seed(0))
    assert float(coherence_of_edges(stripes, 4.0).min()) > 0.95
    assert float(coherence_of_edges(noise, 4.0).mean()) < 0.4
    assert float(coherence_of_edges(torch.zeros(3, 5, 5), 4.0).max()) == 0


def test_parted_colours_agree_with_a_loop():
    picture = torch.rand(3, 9, 11, generator=torch.Generator().manual_seed(2), dtype=torch.float64)
    luma, expected = luma_of(picture), picture.clone()
    once = gaussian_blur(luma, 1.0)
    darker = (gaussian_blur(once, 1.0) - once)[0] / FAINT
    for row in range(9):
        for column in range(11):
            near = [(r, c) for r in range(row - 1, row + 2) for c in range(column - 1, column + 2)]
            near = [(min(max(r, 0), 8), min(max(c, 0), 10)) for r, c in near]
            choose, share = (min if darker[row, column] > 0 else max), min(abs(float(darker[row, column])), 1)
            r, c = choose(near, key=lambda place: float(luma[0][place]))
            expected[:, row, column] += share * (picture[:, r, c] - picture[:, row, column])
    assert_close(sharpen_edges(picture, 1.0, 1), expected)


def test_lines_average_what_they_cross():
    picture = torch.rand(1, 5, 40, generator=torch.Generator().manual_seed(3), dtype=torch.float64)
    means = average_along(picture, torch.zeros(5, 40), 7.0)[0, 2, 10:30]
    expected = [np.mean([picture[0, 2, column + step] for step in range(-7, 8)]) for column in range(10, 30)]
    assert_close(means, torch.tensor(expected, dtype=torch.float64), atol=1e-6, rtol=0)


def test_a_paper_cleans_edges_and_passes_gradients():
    picture = frayed().double().requires_grad_()
    paper = build_named("paper", "cold_pressed", {"tooth": 0, "grain": 40.0, "clean": 1.5})
    seen = paper.cover(picture, torch.ones(3, dtype=torch.float64), Rows(0, 80, (80, 80)))
    places = [(0.9 - one[0, 10:-10].detach()).sum(1) / 0.7 for one in (picture, seen)]
    assert float(places[1].std()) < 0.7 * float(places[0].std())
    seen.sum().backward()
    assert picture.grad is not None
    assert float(picture.grad.sum()) == pytest.approx(3 * 80 * 80, rel=0.05)  # colours move, but none is lost
