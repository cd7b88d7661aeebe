"""Structural similarity as a loss: against torchmetrics and loops, at the extremes, and on a part of a canvas."""

import numpy as np
import pytest
import torch
from skimage.metrics import structural_similarity
from torch import Tensor
from torch.testing import assert_close
from torchmetrics.functional.image import structural_similarity_index_measure

from brushexp.plugins.loss import ssim
from brushexp.plugins.loss.base import Painting
from brushexp.plugins.loss.ssim import StructuralSimilarity
from brushexp.strokes.catalogue import Strokes


def judged(image: Tensor, target: Tensor) -> Tensor:
    return StructuralSimilarity()(Painting(image, target, Strokes.none()))


def pair(height: int, width: int) -> tuple[Tensor, Tensor]:
    target = torch.rand(3, height, width, dtype=torch.float64)
    return (target + 0.2 * torch.randn_like(target)).clamp(0, 1), target


@pytest.mark.parametrize("size", [(6, 6), (11, 17), (37, 50), (64, 23)])
def test_value_agrees_with_torchmetrics(size):
    image, target = pair(*size)
    wanted = 1 - structural_similarity_index_measure(image[None], target[None], data_range=1.0)
    assert_close(judged(image, target), wanted, rtol=0, atol=1e-6)
    assert_close(judged(image.float(), target.float()), wanted.float(), rtol=0, atol=1e-4)


def test_value_agrees_with_scikit_image_away_from_the_border():
    image, target = pair(40, 31)
    options = {"channel_axis": 0, "data_range": 1.0, "full": True}
    _, wanted = structural_similarity(
        image.numpy(), target.numpy(), gaussian_weights=True, sigma=1.5, use_sample_covariance=False, **options
    )
    found = ssim.dissimilarity(image, target, *ssim.statistics(target))
    inside = np.s_[:, 5:-5, 5:-5]
    assert_close(found[inside], torch.tensor(1 - wanted)[inside])


@pytest.mark.parametrize("size", [(1, 1), (1, 7), (3, 5), (5, 40)])
def test_small_pictures_have_smaller_windows(size):
    image, target = pair(*size)
    height, width = size
    down, across = min(5, height - 1), min(5, width - 1)
    values = []
    for channel in range(3):
        x, y = (np.pad(p[channel].numpy(), ((down, down), (across, across)), mode="reflect") for p in (image, target))
        steps = [np.exp(-((np.arange(-r, r + 1) / 1.5) ** 2) / 2) for r in (down, across)]
        weights = np.outer(*steps) / np.outer(*steps).sum()
        for row in range(height):
            for column in range(width):
                a, b = (p[row : row + 2 * down + 1, column : column + 2 * across + 1] for p in (x, y))
                m, n = (weights * a).sum(), (weights * b).sum()
                v, w, c = ((weights * p).sum() for p in ((a - m) ** 2, (b - n) ** 2, (a - m) * (b - n)))
                similar = (2 * m * n + 1e-4) / (m * m + n * n + 1e-4)
                values.append(1 - similar * (2 * c + 9e-4) / (v + w + 9e-4))
    assert float(judged(image, target)) == pytest.approx(np.mean(values), abs=1e-9)


@pytest.mark.parametrize("size", [(1, 1), (1, 9), (13, 20), (70, 33)])
def test_equal_pictures_cost_exactly_nothing(size):
    for image in (torch.rand(3, *size), torch.zeros(3, *size), torch.full((3, *size), 0.3)):
        x = image.clone().requires_grad_()
        value = judged(x, image)
        assert value == 0
        assert (torch.autograd.grad(value, x)[0] == 0).all()


@pytest.mark.parametrize("size", [(1, 1), (1, 9), (13, 20)])
def test_extremes_are_finite_and_within_bounds(size):
    bright = torch.zeros(3, *size)
    bright[:, 0, -1] = 1
    extremes = [torch.zeros(3, *size), torch.ones(3, *size), torch.rand(3, *size).round(), bright]
    for image in extremes:
        for target in extremes:
            x = image.clone().requires_grad_()
            value = judged(x, target)
            assert 0 <= value <= 2
            assert torch.autograd.grad(value, x)[0].isfinite().all()


def test_it_has_the_right_slope():
    for size in ((1, 1), (2, 7), (8, 12)):
        image, target = pair(*size)
        assert torch.autograd.gradcheck(lambda x, y=target: judged(x, y), image.requires_grad_(), fast_mode=True)


def test_the_target_is_looked_at_once(monkeypatch):
    calls = []
    monkeypatch.setattr(ssim, "statistics", lambda p, do=ssim.statistics: calls.append(1) or do(p))
    loss, (image, target) = StructuralSimilarity(), pair(12, 14)
    for _ in range(3):
        loss(Painting(image, target, Strokes.none()))
    assert len(calls) == 1
    assert_close(loss(Painting(target, image, Strokes.none())), judged(target, image))
    assert len(calls) == 3


def test_descent_brings_structure_back():
    _, target = pair(20, 30)
    image = target.mean((1, 2), keepdim=True).expand_as(target).clone().requires_grad_()
    optimizer = torch.optim.Adam([image], lr=0.1)
    for _ in range(30):
        optimizer.zero_grad()
        loss = judged(image, target)
        loss.backward()
        optimizer.step()
    assert judged(image, target) < 0.2
