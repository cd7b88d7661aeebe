"""Blend only the top k strokes of each pixel, as in the thesis."""

from dataclasses import dataclass
from functools import partial
from typing import Annotated

import torch
from torch import Tensor

from brushexp.contracts import at_least, register
from brushexp.contracts.families import Blend, match_dtype
from brushexp.contracts.layers import Canvas, Layers, Size, paint_tiles
from brushexp.contracts.members import over


@register("blend", "topk")
@dataclass(kw_only=True, eq=False)
class TopK(Blend):
    """Blend the top k non-empty strokes of each pixel in plain PyTorch (thesis 2020, eq. 6.8 to 6.21).

    Unlike in the source, strokes are looked up per tile instead of being scattered as windows, and a cumulative product
    over the layers above replaces a k x k matrix per pixel. The background is directly below the k-th stroke.

    Args:
        k: number of strokes blended per pixel; in the thesis, the largest number on any pixel (``blend=topk_all``).
    """

    cost = "about 300"
    exact = "the top k strokes"
    layered = False

    k: Annotated[int, at_least(1)] = 8

    def __call__(
        self, layers: Layers, front_to_back: Tensor, size: Size, background: Tensor, target: Tensor | None = None
    ) -> Canvas:
        background, target = match_dtype(layers, background, target)
        return paint_tiles(layers, front_to_back, size, background, target, partial(_uppermost, self.k))


def _uppermost(k: int, alpha: Tensor, color: Tensor) -> tuple[Tensor, Tensor]:
    """Composite the top k non-empty layers out of K (T, K, P), as `over` does."""
    k = min(k, alpha.shape[1])
    filled = alpha > 0
    rank = torch.where(filled, filled.cumsum(1) - 1, k).clamp_max(k)  # (T, K, P) rank from the top; k if dropped
    place = torch.zeros(alpha.shape[0], k + 1, alpha.shape[2], dtype=torch.long, device=alpha.device)
    layer = torch.arange(alpha.shape[1], device=alpha.device)[:, None].expand_as(rank)
    place.scatter_(1, rank, layer)
    chosen = place[:, :k]  # (T, k, P) stroke at each rank
    present = torch.arange(k, device=alpha.device)[:, None] < filled.sum(1, keepdim=True)
    channels = color.shape[-1]
    color = color.expand(*alpha.shape, channels).gather(1, chosen[..., None].expand(*chosen.shape, channels))
    return over(alpha.gather(1, chosen) * present, color)
