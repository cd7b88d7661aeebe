"""Eager PyTorch on tile lists: any dtype, device and renderer; what the compiled kernels are measured against."""

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor
from torch.utils.checkpoint import checkpoint

from brushexp.compositing.layers import Layers
from brushexp.compositing.tile_lists import TILE, tile_lists
from brushexp.plugins.blend.base import Canvas, accuracy_of

CHUNK = 2**25  # stroke-pixel pairs held at once; more is computed in pieces, and again in the backward pass

# (alpha (T, K, P), color (T, K, P or 1, 3)) -> (painted (T, P, 3), light left for the background (T, P))
Combine = Callable[[Tensor, Tensor], tuple[Tensor, Tensor]]


@dataclass(frozen=True)
class PaddedLists:
    """Tile lists as one rectangle.

    Attributes:
        index: (T, K) strokes front to back, -1 where a list has ended.
        points: (T, P, 2) pixel centres.
        shape: rows and columns of tiles.
    """

    index: Tensor
    points: Tensor
    shape: tuple[int, int]


def padded_lists(layers: Layers, front_to_back: Tensor, size: tuple[int, int]) -> PaddedLists:
    """The tile lists of layers as a rectangle; the numbers are those of the strokes."""
    lists, like = tile_lists(layers.curve, layers.reach, front_to_back, size), layers.curve
    first, stroke = torch.from_numpy(lists.first), torch.from_numpy(lists.stroke).long()
    counts = first.diff()
    tile = torch.repeat_interleave(torch.arange(len(counts)), counts)
    index = torch.full((len(counts), int(counts.max())), -1)
    index[tile, torch.arange(len(stroke)) - first[tile]] = front_to_back.cpu()[stroke]
    tiles, pixels = torch.arange(len(counts))[:, None], torch.arange(TILE * TILE)
    x = tiles % lists.shape[1] * TILE + pixels % TILE
    y = tiles // lists.shape[1] * TILE + pixels // TILE
    points = torch.stack([x, y], dim=-1).to(like) + 0.5
    return PaddedLists(index.to(like.device), points, lists.shape)


def paint_tiles(
    layers: Layers,
    front_to_back: Tensor,
    size: tuple[int, int],
    background: Tensor,
    target: Tensor | None,
    combine: Combine,
) -> Canvas:
    """Combine the strokes of every tile into a picture."""
    lists = padded_lists(layers, front_to_back, size)
    error, total = (layers.reach.new_zeros(len(layers.reach)) for _ in range(2))
    goal = None if target is None else _to_tiles(target, lists.shape)  # (T, P, 3)

    def paint(index: Tensor, points: Tensor) -> Tensor:
        alpha, color = layers.sample(index.clamp_min(0), points)
        painted, light = combine(alpha * (index >= 0)[..., None], color)
        return painted + light[..., None] * background

    per_chunk = max(1, CHUNK // max(1, lists.index.shape[1] * TILE * TILE))
    pieces = []
    for begin in range(0, len(lists.index), per_chunk):
        part = slice(begin, begin + per_chunk)
        index, points = lists.index[part], lists.points[part]
        whole = per_chunk >= len(lists.index)
        pieces.append(paint(index, points) if whole else checkpoint(paint, index, points, use_reentrant=False))
        if goal is not None:
            _judge(layers, index, points, goal[part], size, error, total)
    image = _from_tiles(torch.cat(pieces), lists.shape, size)
    return Canvas(image, None if target is None else accuracy_of(error, total))


@torch.no_grad()
def _judge(
    layers: Layers, index: Tensor, points: Tensor, goal: Tensor, size: tuple[int, int], error: Tensor, total: Tensor
) -> None:
    """Add each stroke's alpha |color - target|^2 and alpha to ``error`` and ``total`` (N,)."""
    alpha, color = layers.sample(index.clamp_min(0), points)
    inside = (points[..., 0] < size[1]) & (points[..., 1] < size[0])
    alpha = alpha * (index >= 0)[..., None] * inside[:, None]
    wrong = (alpha * (color - goal[:, None]).square().sum(-1)).sum(-1)
    error.index_add_(0, index.clamp_min(0).flatten(), wrong.flatten())
    total.index_add_(0, index.clamp_min(0).flatten(), alpha.sum(-1).flatten())


def _to_tiles(image: Tensor, shape: tuple[int, int]) -> Tensor:
    """(3, H, W) -> (T, P, 3), zeros beyond the edge."""
    rows, columns = shape
    _, height, width = image.shape
    padded = torch.nn.functional.pad(image, (0, columns * TILE - width, 0, rows * TILE - height))
    return padded.view(3, rows, TILE, columns, TILE).permute(1, 3, 2, 4, 0).reshape(-1, TILE * TILE, 3)


def _from_tiles(tiles: Tensor, shape: tuple[int, int], size: tuple[int, int]) -> Tensor:
    """(T, P, 3) -> (3, H, W)."""
    rows, columns = shape
    image = tiles.view(rows, columns, TILE, TILE, 3).permute(4, 0, 2, 1, 3).reshape(3, rows * TILE, columns * TILE)
    return image[:, : size[0], : size[1]]
