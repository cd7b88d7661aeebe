"""Test that MS-SSIM agrees with a direct implementation of its definition."""

import pytest
import torch
from brushexp_thesis.ms_ssim import SMALLEST_SIDE, MultiscaleSimilarity
from torch.nn.functional import avg_pool2d, conv2d

from brushexp.plugins.metric.base import Comparison

WEIGHTS = 0.0448, 0.2856, 0.3001, 0.2363, 0.1333  # weights of the scales, finest first (Wang et al., 2003, 3.2)


def by_definition(image, target):
    """Compute MS-SSIM without padding: contrast and structure at every scale, times the luminance at the last scale."""
    places = torch.arange(-5, 6, dtype=torch.float64)
    window = torch.exp(-(places[:, None] ** 2 + places**2) / (2 * 1.5**2))
    window = (window / window.sum())[None, None].expand(3, 1, 11, 11)

    def mean(values):
        return conv2d(values, window, groups=3)

    product = 1.0
    for k, weight in enumerate(WEIGHTS):
        x, y = mean(image), mean(target)
        covariance = mean(image * target) - x * y
        structure = (2 * covariance + 0.03**2) / (mean(image**2) - x**2 + mean(target**2) - y**2 + 0.03**2)
        luminance = (2 * x * y + 0.01**2) / (x**2 + y**2 + 0.01**2)
        product *= float((structure if k < 4 else structure * luminance).mean()) ** weight
        image, target = avg_pool2d(image, 2), avg_pool2d(target, 2)
    return product


def test_it_is_that_of_its_source():
    target = torch.rand(3, 176, 208, generator=torch.Generator().manual_seed(3))
    image = (target + 0.1 * torch.randn(target.shape, generator=torch.Generator().manual_seed(4))).clamp(0, 1)
    expected = by_definition(image[None].double(), target[None].double())
    assert MultiscaleSimilarity()(Comparison(image, target)) == pytest.approx(expected, abs=2e-3)
    assert MultiscaleSimilarity()(Comparison(target, target)) == pytest.approx(1)


def test_small_pictures_have_none():
    small = torch.zeros(3, SMALLEST_SIDE - 1, 400)
    assert MultiscaleSimilarity()(Comparison(small, small)) is None
