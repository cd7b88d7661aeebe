"""Composite tile by tile in eager PyTorch, for any dtype, device and renderer."""

from collections.abc import Callable

import torch
from torch import Tensor
from torch.nn import functional
from torch.utils.checkpoint import checkpoint

from brushexp.compositing.layers import Canvas, Layers, Size, accuracy_of
from brushexp.compositing.tile_lists import TILE, tile_lists

CHUNK = 2**25  # stroke-pixel pairs held at once; bigger jobs are split, and recomputed in the backward pass

# (alpha (T, K, P), color (T, K, P or 1, C)) -> (painted (T, P, C), light left for the background (T, P))
Combine = Callable[[Tensor, Tensor], tuple[Tensor, Tensor]]


def padded_lists(layers: Layers, front_to_back: Tensor, size: Size) -> tuple[Tensor, Tensor]:
    """Return the strokes (T, K) in each tile, front to back and padded with -1, and the pixel centres (T, P, 2)."""
    lists, like = tile_lists(layers.curve, layers.reach, front_to_back, size), layers.curve
    first, stroke = torch.from_numpy(lists.first), torch.from_numpy(lists.stroke).long()
    counts = first.diff()
    tile = torch.repeat_interleave(torch.arange(len(counts)), counts)
    index = torch.full((len(counts), int(counts.max())), -1)
    index[tile, torch.arange(len(stroke)) - first[tile]] = front_to_back.cpu()[stroke]
    tiles, pixels = torch.arange(len(counts))[:, None], torch.arange(TILE * TILE)
    x = tiles % lists.shape[1] * TILE + pixels % TILE
    y = tiles // lists.shape[1] * TILE + pixels // TILE
    return index.to(like.device), torch.stack([x, y], dim=-1).to(like) + 0.5


def paint_tiles(
    layers: Layers, front_to_back: Tensor, size: Size, background: Tensor, target: Tensor | None, combine: Combine
) -> Canvas:
    """Composite the strokes in every tile into a picture."""
    every, centres = padded_lists(layers, front_to_back, size)
    error, total = layers.reach.new_zeros(2, len(layers.reach))
    whole = -(-size[0] // TILE) * TILE, -(-size[1] // TILE) * TILE  # (H, W) of all tiles
    goal = None if target is None else _to_tiles(target, whole)  # (T, P, 3)

    def paint(index: Tensor, points: Tensor) -> Tensor:
        alpha, color = layers.sample(index.clamp_min(0), points)
        color_sum, light = combine(alpha * (index >= 0)[..., None], color)
        return color_sum + light[..., None] * background

    per_chunk = max(1, CHUNK // max(1, every.shape[1] * TILE * TILE))
    pieces = []
    for begin in range(0, len(every), per_chunk):
        part = slice(begin, begin + per_chunk)
        index, points = every[part], centres[part]
        fits = per_chunk >= len(every)
        pieces.append(paint(index, points) if fits else checkpoint(paint, index, points, use_reentrant=False))
        if goal is not None:
            _judge(layers, index, points, goal[part], size, error, total)
    tiles = torch.cat(pieces).permute(2, 1, 0).reshape(1, len(background) * TILE * TILE, -1)
    image = functional.fold(tiles, whole, TILE, stride=TILE)[0, :, : size[0], : size[1]]
    return Canvas(image, None if target is None else accuracy_of(error, total))


@torch.no_grad()
def _judge(
    layers: Layers, index: Tensor, points: Tensor, goal: Tensor, size: Size, error: Tensor, total: Tensor
) -> None:
    """Add each stroke's alpha |color - target|^2 to ``error`` (N,), and its alpha to ``total`` (N,)."""
    alpha, color = layers.sample(index.clamp_min(0), points)
    inside = (points[..., 0] < size[1]) & (points[..., 1] < size[0])
    alpha = alpha * (index >= 0)[..., None] * inside[:, None]
    wrong = (alpha * (color - goal[:, None]).square().sum(-1)).sum(-1)
    error.index_add_(0, index.clamp_min(0).flatten(), wrong.flatten())
    total.index_add_(0, index.clamp_min(0).flatten(), alpha.sum(-1).flatten())


def _to_tiles(image: Tensor, whole: Size) -> Tensor:
    padded = functional.pad(image, (0, whole[1] - image.shape[2], 0, whole[0] - image.shape[1]))
    return functional.unfold(padded[None], TILE, stride=TILE).reshape(3, TILE * TILE, -1).permute(2, 1, 0)
