"""Statistics of features that the style loss compares: the kernels and their embeddings."""

import math
from collections.abc import Callable
from enum import Enum

import torch
from torch import Tensor

FOURIER_FEATURES = 256  # of each tap
BANDWIDTH_POSITIONS = 512  # positions whose distances give the bandwidth of the gaussian kernel
VARIANCE_OFFSET = 1e-5  # of the style's mean square, added to variances: the root of 0 has no slope
MIN_FEATURE_POWER = 1e-8  # mean square of the style's features that is divided by, at least

Embedding = Callable[[Tensor], Tensor]  # features (C, P) of P positions -> sum over them of what the kernel compares


class FeatureKernel(Enum):
    """Which statistic of the features is compared."""

    poly = "poly"
    linear = "linear"
    gaussian = "gaussian"
    meanstd = "meanstd"


def gram(features: Tensor) -> Tensor:
    """Sum of the products of channels (C * C,) over positions; features (C, P)."""
    return (features @ features.T).flatten()


def sum_of(features: Tensor) -> Tensor:
    """Sum of each channel (C,)."""
    return features.sum(1)


def powers_of(features: Tensor) -> Tensor:
    """Sums of each channel and of its square (2 C,)."""
    return torch.cat([features.sum(1), features.square().sum(1)])


def waves_for(sample: Tensor) -> Embedding:
    """Random Fourier features (Rahimi and Recht, 2007) of the kernel exp(-|f - g|^2 / (2 s^2)).

    The bandwidth s is the median distance in a sample (C, P) of the style, at least a thousandth of its features'
    length where they are all alike. The waves come from a seed of their own: they are the same in every run.
    """
    sample = sample[:, :: max(1, sample.shape[1] // BANDWIDTH_POSITIONS)].double()
    least = 1e-3 * sample.square().sum(0).mean().sqrt() + MIN_FEATURE_POWER
    width = float(torch.cdist(sample.T, sample.T).median().clamp_min(least))
    generator = torch.Generator().manual_seed(0)
    directions = torch.randn(FOURIER_FEATURES, len(sample), generator=generator, dtype=torch.float64) / width
    phases = 2 * math.pi * torch.rand(FOURIER_FEATURES, 1, generator=generator, dtype=torch.float64)

    def embed(features: Tensor) -> Tensor:
        waves = torch.cos(directions.to(features) @ features + phases.to(features))
        return math.sqrt(2 / FOURIER_FEATURES) * waves.sum(1)

    return embed


EMBEDDINGS: dict[FeatureKernel, Callable[[Tensor], Embedding]] = {
    FeatureKernel.poly: lambda sample: gram,
    FeatureKernel.linear: lambda sample: sum_of,
    FeatureKernel.gaussian: waves_for,
    FeatureKernel.meanstd: lambda sample: powers_of,
}
POWERS: dict[FeatureKernel, Callable[[Tensor], Tensor]] = {  # sum of k(f, f) over positions
    FeatureKernel.poly: lambda features: features.square().sum(0).square().sum(),
    FeatureKernel.linear: lambda features: features.square().sum(),
    FeatureKernel.gaussian: lambda features: features.new_tensor(features.shape[1]),
    FeatureKernel.meanstd: lambda features: features.square().sum(),
}


def discrepancy(found: Tensor, wanted: Tensor, unit: float, kernel: FeatureKernel) -> Tensor:
    """Squared difference of two mean embeddings in units of k(f, f)."""
    if kernel is FeatureKernel.meanstd:
        found, wanted = (mean_and_deviation(mean, VARIANCE_OFFSET * unit) for mean in (found, wanted))
    return (found - wanted).square().sum() / unit


def mean_and_deviation(moments: Tensor, floor: float) -> Tensor:
    """First and second moments (2 C,) -> means and standard deviations, whose variances are ``floor`` at least."""
    mean, square = moments.chunk(2)
    return torch.cat([mean, ((square - mean.square()).clamp_min(0) + floor).sqrt()])
