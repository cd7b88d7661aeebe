"""The thesis's blend: only the k uppermost strokes of each pixel."""

import torch
from torch import Tensor

from brushexp.blend.base import Blend, Canvas
from brushexp.blend.tiled import Tiled
from brushexp.errors import UserError
from brushexp.registry import register
from brushexp.renderer.base import Layers


@register("blend", "topk")
class TopK(Blend):
    """The k uppermost strokes that are not empty at a pixel, in plain PyTorch (thesis 2020, eq. 6.8 to 6.21).

    Differs from the source: strokes are looked up per tile instead of being scattered as windows, and the product over
    the layers above is a cumulative one instead of a k x k matrix per pixel. What lies below the k-th stroke is the
    background.

    Args:
        k: strokes that are blended per pixel, at least 1; null: as many as the fullest pixel has, as in the thesis.
            Then none is left out, so ``tiled`` computes it.
    """

    def __init__(self, *, k: int | None = 8) -> None:
        from brushexp.blend import _eager  # noqa: PLC0415  (Numba takes a second to import; --help should not)

        if k is not None and k < 1:
            raise UserError(f"blend.k={k} blends nothing; use blend.k=8 or another number from 1")
        self.k = k
        self._eager = _eager
        self._exact = Tiled(opaque=0)

    def __call__(
        self,
        layers: Layers,
        front_to_back: Tensor,
        size: tuple[int, int],
        background: Tensor,
        target: Tensor | None = None,
    ) -> Canvas:
        if self.k is None:
            return self._exact(layers, front_to_back, size, background, target)
        lists = self._eager.pad(self._eager.lists_of(layers, front_to_back, size), front_to_back, background)
        return self._eager.paint_tiles(layers, lists, size, background, target, self._uppermost)

    def _uppermost(self, alpha: Tensor, index: Tensor) -> Tensor:
        """The k uppermost of the strokes (T, K) that are not empty, for each pixel: (T, P, k), -1 for none.

        Only these are then asked with a gradient.
        """
        assert self.k is not None
        filled = alpha > 0
        k = min(self.k, int(filled.sum(1).max()) if filled.numel() else 0)
        rank = torch.where(filled, filled.cumsum(1) - 1, k).clamp_max(k)  # place from the top; k: dropped
        chosen = index.new_full((len(index), k + 1, alpha.shape[2]), -1)
        chosen.scatter_(1, rank, index[..., None].expand_as(rank))
        return chosen[:, :k].movedim(1, 2)
