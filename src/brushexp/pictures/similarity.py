"""Measure the similarity between two pictures: PSNR, and SSIM around each pixel."""

import math

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from brushexp.system.precision import at_least_single

RADIUS, SIGMA = 5, 1.5  # pixels; the window of SSIM is 11 x 11
C1, C2 = 0.01**2, 0.03**2  # constants of Wang et al., for pictures in [0, 1]


def psnr_of(mean_squared_error: float) -> float:
    """Compute the peak signal-to-noise ratio, in dB, of pictures in [0, 1]; it is infinite for an error of 0."""
    return -10 * math.log10(mean_squared_error) if mean_squared_error > 0 else math.inf


def picture_psnr(picture: np.ndarray, target: np.ndarray) -> float:
    """Compute the PSNR, in dB, between two 8-bit pictures of the same shape."""
    return psnr_of(float(np.square((picture.astype(np.float64) - target) / 255).mean()))


def statistics(picture: Tensor) -> tuple[Tensor, Tensor]:
    """Compute the mean and variance (3, H, W) of the window around each pixel of a picture (3, H, W)."""
    picture = at_least_single(picture)
    mean, square = gaussian_mean(torch.cat([picture, picture.square()])).split(3)
    return mean, square - mean.square()


def dissimilarity(image: Tensor, target: Tensor, mean: Tensor, variance: Tensor) -> Tensor:
    """Compute 1 - SSIM (3, H, W) between two pictures (3, H, W); ``mean`` and ``variance`` are those of the target.

    If d is the difference between the pictures, then 2 m n = m^2 + n^2 - E[d]^2 for the means m and n, and likewise for
    covariances, so that SSIM = (1 - E[d]^2 / (m^2 + n^2 + C1)) (1 - V[d] / (V[x] + V[y] + C2)).
    """
    image, target = at_least_single(image), at_least_single(target)
    difference = image - target
    mean_d, square_d, square = gaussian_mean(torch.cat([difference, difference.square(), image.square()])).split(3)
    ours = mean + mean_d
    of_means = mean_d.square() / (ours.square() + mean.square() + C1)
    variance_d = (square_d - mean_d.square()).clamp_min(0)  # rounding may produce less
    of_structure = variance_d / (square - ours.square() + variance + C2)
    return of_means + of_structure - of_means * of_structure


def gaussian_mean(pictures: Tensor) -> Tensor:
    """Compute the Gaussian-weighted mean around each pixel of a picture (C, H, W), which is mirrored at the border."""
    count, (down, across) = len(pictures), (min(RADIUS, side - 1) for side in pictures.shape[1:])
    steps = (torch.arange(-r, r + 1).to(pictures) for r in (down, across))
    column, row = ((-((step / SIGMA) ** 2) / 2).softmax(0) for step in steps)
    mirrored = functional.pad(pictures[None], (across, across, down, down), mode="reflect")
    mirrored = mirrored.contiguous(memory_format=torch.channels_last)  # takes half the time or less
    narrower = functional.conv2d(mirrored, row.expand(count, 1, 1, -1), groups=count)
    return functional.conv2d(narrower, column[:, None].expand(count, 1, -1, -1), groups=count)[0]
