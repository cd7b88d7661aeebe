"""Compute random fields as functions of position alone, so that they are the same at any picture size."""

import math
from functools import lru_cache

import numpy as np
import torch
from torch import Tensor

from brushexp_media.picture.smoothing import average_along

CELLS = 1024  # period of the noise
DEVIATION = 0.215  # approximate standard deviation of `gradient_noise`
LINE_REACH = 6.0  # reach of a line to each side, in grains
EVENED = 3.8  # ratio of the deviation of noise to that of its means along lines
TURN = 0.6  # rotation between octaves in radians, which hides the axes of the cells


def gradient_noise(x: Tensor, y: Tensor, seed: int) -> Tensor:
    """Compute gradient noise (float32) of mean 0, with cells of side 1, at positions of any shape (Perlin, 1985).

    Unlike in the source, gradients are unit vectors, and the interpolant is from Perlin (2002).
    """
    left, top = x.floor(), y.floor()
    u, v = (x - left).float(), (y - top).float()
    column, row = left.long() % CELLS, top.long() % CELLS
    order, across, down = _tables(seed)
    corners = []
    for dx, dy in ((0, 0), (1, 0), (0, 1), (1, 1)):
        number = order[(order[(column + dx) % CELLS] + row + dy) % CELLS]
        corners.append(across[number] * (u - dx) + down[number] * (v - dy))
    along, downwards = (t * t * t * (t * (t * 6 - 15) + 10) for t in (u, v))
    above, below = torch.lerp(corners[0], corners[1], along), torch.lerp(corners[2], corners[3], along)
    return torch.lerp(above, below, downwards)


@lru_cache(maxsize=64)
def _tables(seed: int) -> tuple[Tensor, Tensor, Tensor]:
    """Sample a permutation of the cells, and a unit vector for each cell."""
    generator = torch.Generator().manual_seed(seed)
    angle = 2 * math.pi * torch.rand(CELLS, generator=generator)
    return torch.randperm(CELLS, generator=generator), angle.cos(), angle.sin()


def fractal_noise(x: Tensor, y: Tensor, seed: int, octaves: int = 3) -> Tensor:
    """Sum octaves of gradient noise, with cells of side 1, 1/2, 1/4 ..., each half as strong as the one before.

    The sum is float32 with a standard deviation of about 1.
    """
    total = torch.zeros(x.shape)
    for k in range(octaves):
        c, s = (2**k * f(TURN * (k + 1)) for f in (math.cos, math.sin))
        total += gradient_noise(c * x - s * y, s * x + c * y, seed + k) * 0.5**k
    return total / (DEVIATION * math.sqrt(sum(0.25**k for k in range(octaves))))


def map_to_uniform(values: Tensor) -> Tensor:
    """Map standard normal values to a uniform distribution on [0, 1] by their cumulative probability."""
    return 0.5 * (1 + torch.erf(values / math.sqrt(2)))


def draw_out(noise: Tensor, angle: Tensor, reach: float) -> Tensor:
    """Average noise (H, W) along lines at an ``angle`` (H, W) in radians, over ``reach`` pixels to either side.

    The result is rescaled to about the same standard deviation as the noise.
    """
    return EVENED * average_along(noise[None], angle, reach)[0]


def noise_of(size: tuple[int, ...], cell: float, random: np.random.Generator) -> np.ndarray:
    """Compute noise (H, W) of mean 0 and standard deviation about 1.

    ``cell`` is the side of the noise's cells, as a fraction of the longer side.
    """
    y, x = (torch.arange(side, dtype=torch.float64) / (cell * max(size)) for side in size)
    noise = fractal_noise(x.expand(len(y), -1), y[:, None].expand(-1, len(x)), int(random.integers(2**31)), 2)
    return noise.double().numpy()
