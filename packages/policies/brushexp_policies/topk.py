"""Blend only the k uppermost strokes of each pixel, as the thesis does."""

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
    """The k uppermost strokes that are not empty at a pixel, in plain PyTorch (thesis 2020, eq. 6.8 to 6.21).

    Differs from the source: strokes are looked up per tile instead of being scattered as windows, and the product over
    the layers above is a cumulative one instead of a k x k matrix per pixel. What lies below the k-th stroke is the
    background.

    Args:
        k: strokes that are blended per pixel; in the thesis as many as the fullest pixel has (``blend=topk_all``).
    """

    cost = "about 300"
    exact = "the k uppermost strokes"
    layered = False

    k: Annotated[int, at_least(1)] = 8

    def __call__(
        self, layers: Layers, front_to_back: Tensor, size: Size, background: Tensor, target: Tensor | None = None
    ) -> Canvas:
        background, target = match_dtype(layers, background, target)
        return paint_tiles(layers, front_to_back, size, background, target, partial(_uppermost, self.k))


def _uppermost(k: int, alpha: Tensor, color: Tensor) -> tuple[Tensor, Tensor]:
    """Lay the k uppermost of K layers (T, K, P) that are not empty over each other, as `over` does."""
    k = min(k, alpha.shape[1])
    filled = alpha > 0
    rank = torch.where(filled, filled.cumsum(1) - 1, k).clamp_max(k)  # (T, K, P): place from the top; k: dropped
    place = torch.zeros(alpha.shape[0], k + 1, alpha.shape[2], dtype=torch.long, device=alpha.device)
    layer = torch.arange(alpha.shape[1], device=alpha.device)[:, None].expand_as(rank)
    place.scatter_(1, rank, layer)
    chosen = place[:, :k]  # (T, k, P): which stroke is at each place
    present = torch.arange(k, device=alpha.device)[:, None] < filled.sum(1, keepdim=True)
    channels = color.shape[-1]
    color = color.expand(*alpha.shape, channels).gather(1, chosen[..., None].expand(*chosen.shape, channels))
    return over(alpha.gather(1, chosen) * present, color)
