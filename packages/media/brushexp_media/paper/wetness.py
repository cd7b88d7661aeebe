"""Wet paint on paper: pigment gathers at the edges of a wash and in hollows, and edges wander with the grain.

Source: Bousseau et al., "Interactive watercolor rendering with temporal coherence and abstraction" (2006).
"""

import torch
from torch import Tensor
from torch.nn import functional

from brushexp_media.picture.noise import fractal_noise
from brushexp_media.picture.smoothing import gaussian_blur, luma_of

DRIFT = 3.0  # grains between positions at which edges wander differently


def gather_pigment(color: Tensor, more: Tensor) -> Tensor:
    """Change the pigment density of a picture (3, H, W) from 1 to 1 + ``more`` (H, W): c becomes c - c (1 - c) more.

    Colours c are in [0, 1]; white paper and black pigment are unchanged.
    """
    return (color - color * (1 - color) * more).clamp(0, 1)


def density_of_edges(picture: Tensor, sigma: float) -> Tensor:
    """Compute how much pigment (H, W) gathers on the darker side of edges, in pixels darker than their surroundings.

    The amount is at most about 1/2, at an edge between white and black, and fades over a distance of ``sigma`` pixels.
    The source instead uses the gradient and darkens both sides.
    """
    luma = luma_of(picture)
    return (gaussian_blur(luma, sigma) - luma)[0].clamp_min(0)


def displace_pixels(picture: Tensor, x: Tensor, y: Tensor, reach: float, seed: int) -> Tensor:
    """Displace the pixels of a picture (3, h, W) by about ``reach`` pixels; x and y (h, W) are positions in grains."""
    height, width = picture.shape[1:]
    shift = [0.5 * fractal_noise(x / DRIFT, y / DRIFT, seed + k, 2).clamp(-3, 3).to(picture) for k in (21, 31)]
    row, column = torch.meshgrid(torch.arange(height), torch.arange(width), indexing="ij")
    places = [
        (2 * (start.to(picture) + 0.5 + reach * by) / side - 1)
        for start, by, side in ((column, shift[0], width), (row, shift[1], height))
    ]
    grid = torch.stack(places, -1)[None]
    return functional.grid_sample(picture[None], grid, padding_mode="border", align_corners=False)[0]
