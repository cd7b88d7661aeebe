"""Textures along and across a stroke: where their texels lie, how they are smoothed, and how a kernel has them."""

import math

import torch
from torch import Tensor

from brushexp.compositing.layers import SPREAD


def coordinates_of(rows: int, columns: int) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Where the texels of a texture with the ring around it lie; all but t in half widths.

    Across (rows + 2,), and of the columns (rows + columns + 2,) t, before the start (negative), and beyond the end.
    """
    step = 2 * SPREAD / rows
    across = step * (torch.arange(rows + 2) - 0.5 - rows / 2)
    u = torch.arange(rows + columns + 2) - 0.5 - rows / 2
    return across, (u / columns).clamp(0, 1), step * u.clamp_max(0), step * (u - columns).clamp_min(0)


def texel_distances(rows: int, columns: int) -> Tensor:
    """Half widths (rows + 2, rows + columns + 2) from the curve to each texel."""
    across, _, before, beyond = coordinates_of(rows, columns)
    return torch.hypot(across[:, None], before + beyond)


def smoothed(opacity: Tensor, light: Tensor, room: Tensor, level: int) -> Tensor:
    """Textures (..., 2, rows, columns) as pixels of 2^level texels see them: a Gaussian with the spread of that square.

    Along the stroke half as much, for there most texels are longer. Light counts by opacity.
    """
    if level == 0:
        return torch.stack([opacity, light], dim=-3)
    sigma = 2**level / math.sqrt(12)
    rows, columns = opacity.shape[-2:]
    weighted = torch.stack([opacity, opacity * light], dim=-3)
    blurred = _gaussian(rows, sigma).to(room) @ weighted @ _gaussian(columns, 0.5 * sigma).to(room)
    covered, lit = blurred.unbind(-3)
    return torch.stack([covered * room, lit / covered.clamp_min(1e-6)], dim=-3)


def _gaussian(n: int, sigma: float) -> Tensor:
    """Matrix (n, n) that blurs n texels, with nothing beyond them."""
    place = torch.arange(n)
    spread = torch.arange(-n, n + 1)
    total = torch.exp(-0.5 * (spread / sigma) ** 2).sum()
    return torch.exp(-0.5 * ((place[:, None] - place) / sigma) ** 2) / total


def extent_of(opacity: Tensor) -> Tensor:
    """Half widths (M,) from the curve, beyond which textures with this opacity (M, rows + 2, columns + 2) are empty."""
    rows = opacity.shape[1] - 2
    distance = texel_distances(rows, opacity.shape[2] - 2 - rows).to(opacity)
    farthest = torch.where(opacity > 0, distance, -1.0).amax((1, 2))
    margin = math.sqrt(2) * 2 * SPREAD / rows  # a texel is felt as far as the next one
    return torch.where(farthest < 0, 0.0, farthest + margin)


def cells_of(steps: Tensor) -> Tensor:
    """The corners of each cell between four texels, as bytes of two words, so that a lookup is two loads.

    ``steps`` (M, 2, rows, columns) are whole numbers: opacity 0 to 255, light -127 to 127. What comes is int32 (M,
    rows - 1, columns - 1, 2): of opacity, and of light + 128, the corners above left, above right, below left and below
    right, the lowest byte first.
    """
    whole = steps.long() + torch.tensor([0, 128], device=steps.device)[:, None, None]
    corners = (whole[..., :-1, :-1], whole[..., :-1, 1:], whole[..., 1:, :-1], whole[..., 1:, 1:])
    word = sum((corner << (8 * k) for k, corner in enumerate(corners)), start=torch.zeros_like(corners[0]))
    return torch.where(word >= 2**31, word - 2**32, word).int().movedim(1, -1).contiguous()
