"""Statistics of features that the style loss compares: the kernels and their embeddings."""

import math
from collections.abc import Callable
from enum import Enum

import torch
from torch import Tensor

WAVES, SAMPLE = 256, 512  # random Fourier features of a tap; positions whose distances give the bandwidth
EVEN = 1e-5  # share of the style's mean square that is added to variances: the root has a slope where there are none
FLOOR = 1e-8  # least mean square of the style's features

Embedding = Callable[[Tensor], Tensor]  # features (C, P) of P positions -> sum over them of what the kernel compares


class Kernel(Enum):
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
    sample = sample[:, :: max(1, sample.shape[1] // SAMPLE)].double()
    width = float(
        torch.cdist(sample.T, sample.T).median().clamp_min(1e-3 * sample.square().sum(0).mean().sqrt() + FLOOR)
    )
    generator = torch.Generator().manual_seed(0)
    directions = torch.randn(WAVES, len(sample), generator=generator, dtype=torch.float64) / width
    phases = 2 * math.pi * torch.rand(WAVES, 1, generator=generator, dtype=torch.float64)

    def embed(features: Tensor) -> Tensor:
        return math.sqrt(2 / WAVES) * torch.cos(directions.to(features) @ features + phases.to(features)).sum(1)

    return embed


EMBEDDINGS: dict[Kernel, Callable[[Tensor], Embedding]] = {
    Kernel.poly: lambda sample: gram,
    Kernel.linear: lambda sample: sum_of,
    Kernel.gaussian: waves_for,
    Kernel.meanstd: lambda sample: powers_of,
}
POWERS: dict[Kernel, Callable[[Tensor], Tensor]] = {  # sum of k(f, f) over positions
    Kernel.poly: lambda features: features.square().sum(0).square().sum(),
    Kernel.linear: lambda features: features.square().sum(),
    Kernel.gaussian: lambda features: features.new_tensor(features.shape[1]),
    Kernel.meanstd: lambda features: features.square().sum(),
}


def discrepancy(found: Tensor, wanted: Tensor, unit: float, kernel: Kernel) -> Tensor:
    """Squared difference of two mean embeddings in units of k(f, f)."""
    if kernel is Kernel.meanstd:
        found, wanted = (mean_and_deviation(mean, EVEN * unit) for mean in (found, wanted))
    return (found - wanted).square().sum() / unit


def mean_and_deviation(moments: Tensor, floor: float) -> Tensor:
    """First and second moments (2 C,) -> means and standard deviations, whose variances are ``floor`` at least."""
    mean, square = moments.chunk(2)
    return torch.cat([mean, ((square - mean.square()).clamp_min(0) + floor).sqrt()])
