"""Smooth pictures uniformly, along their edges, or without crossing their edges."""

import math

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from brushexp.contracts.pictures import along_edges, structure_tensor
from brushexp_media.picture.lines import LUMA, anisotropy_of

SAMPLES = 15  # points along a line at which a picture is sampled
FAINT = 0.01  # difference of luma from the blurred picture above which a pixel moves fully to one side of an edge

# scale in sigmas at which edges have one direction; coherence at which nothing, and all, is cleaned
WIDE, LOWEST_COHERENCE, HIGHEST_COHERENCE = (
    4.0,
    0.3,
    0.6,
)


def luma_of(picture: Tensor) -> Tensor:
    """Compute the luma (1, H, W) of a picture (3, H, W)."""
    return (picture.new_tensor(LUMA)[:, None, None] * picture).sum(0, keepdim=True)


def gaussian_blur(picture: Tensor, sigma: float) -> Tensor:
    """Blur a picture (C, H, W) with a Gaussian of ``sigma`` pixels, repeating the pixels at its border."""
    reach = max(1, math.ceil(3 * sigma))
    weights = torch.exp(-0.5 * (torch.arange(-reach, reach + 1, dtype=torch.float64) / max(sigma, 1e-3)) ** 2)
    weights = (weights / weights.sum()).to(picture)
    rows = functional.pad(picture[:, None], (0, 0, reach, reach), mode="replicate")
    rows = functional.conv2d(rows, weights[None, None, :, None])
    columns = functional.pad(rows, (reach, reach, 0, 0), mode="replicate")
    return functional.conv2d(columns, weights[None, None, None])[:, 0]


def direction_of_edges(picture: Tensor, sigma: float) -> Tensor:
    """Compute the direction (H, W), in radians, of the edges in a picture (3, H, W), smoothed over ``sigma`` pixels."""
    return torch.from_numpy(along_edges(_tensor(picture, sigma))).float()


def coherence_of_edges(picture: Tensor, sigma: float) -> Tensor:
    """Compute the coherence (H, W), 0 to 1, of edge directions in a picture (3, H, W), over ``sigma`` pixels.

    It is the difference between the structure tensor's eigenvalues, divided by their sum (Bigun and Granlund, 1987).
    """
    return torch.from_numpy(anisotropy_of(_tensor(picture, sigma))).to(picture)


def _tensor(picture: Tensor, sigma: float) -> np.ndarray:
    return structure_tensor(picture.detach().double().cpu().numpy(), sigma)


def average_along(picture: Tensor, angle: Tensor, reach: float) -> Tensor:
    """Average a picture (C, H, W) along lines at an ``angle`` (H, W) in radians, over ``reach`` pixels to each side.

    Source: line integral convolution (Cabral and Leedom, 1993). Unlike in the source, lines are straight.
    """
    height, width = angle.shape
    row, column = torch.meshgrid(torch.arange(height) + 0.5, torch.arange(width) + 0.5, indexing="ij")
    total = torch.zeros_like(picture)
    for step in torch.linspace(-reach, reach, SAMPLES).tolist():
        x, y = column + step * angle.cos(), row + step * angle.sin()
        places = torch.stack([2 * x / width - 1, 2 * y / height - 1], -1)[None].to(picture)
        total = total + functional.grid_sample(picture[None], places, padding_mode="reflection", align_corners=False)[0]
    return total / SAMPLES


def sharpen_edges(picture: Tensor, sigma: float, reach: int) -> Tensor:
    """Sharpen a picture's edges (3, H, W): each colour becomes the darkest or lightest within ``reach`` pixels.

    Pixels that are darker than their surroundings at the scale of ``sigma`` pixels take the darkest colour, and all
    others the lightest. Pixels that hardly differ from their surroundings change less.

    Source: the shock filter of Kyprianidis and Kang (2011). Unlike in the source, whole colours are chosen by luma.
    """
    luma = luma_of(picture)
    once = gaussian_blur(luma, sigma)
    darker = (gaussian_blur(once, sigma) - once) / FAINT
    wide, side = functional.pad(picture, (reach,) * 4, mode="replicate").flatten(1), 2 * reach + 1
    light, dark = (
        wide[:, functional.max_pool2d(functional.pad(sign * luma, (reach,) * 4, mode="replicate"), side, 1,
                                      return_indices=True)[1].flatten()].view_as(picture)
        for sign in (1, -1)
    )  # fmt: skip
    return torch.lerp(picture, torch.where(darker > 0, dark, light), darker.abs().clamp(max=1))


def with_clean_edges(picture: Tensor, sigma: float, reach: float) -> Tensor:
    """Smooth a picture (3, H, W) along its edges, over ``reach`` pixels to each side, without blurring the edges.

    The directions and sides of edges are determined at the scale of ``sigma`` pixels; smaller forms become rounded.
    Where edges have no common direction, as in foliage and eyes, the picture is unchanged.

    Source: coherence-enhancing filtering (Kyprianidis and Kang, 2011). Unlike in the source, there is a single
    iteration, along straight lines, weighted by coherence. Directions and sides are treated as constant, so that
    gradients flow only through colours.
    """
    even = average_along(picture, direction_of_edges(picture, sigma), reach)
    sharp = sharpen_edges(even, sigma, max(1, round(sigma)))
    clean = average_along(sharp, direction_of_edges(sharp, sigma), reach / 2)
    coherent = (coherence_of_edges(picture, WIDE * sigma) - LOWEST_COHERENCE) / (HIGHEST_COHERENCE - LOWEST_COHERENCE)
    return torch.lerp(picture, clean, coherent.clamp(0, 1))
