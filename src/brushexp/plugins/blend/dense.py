"""Blend every stroke at every pixel, as a reference implementation."""

import torch
from torch import Tensor

from brushexp.compositing.layers import Canvas, Layers, Size, accuracy_of
from brushexp.errors import UserError
from brushexp.plugins.blend.base import Blend, match_dtype, pixel_centres
from brushexp.registry import register

LIMIT = 4e8  # stroke-pixel pairs; beyond this, intermediate tensors take tens of gigabytes


@register("blend", "dense")
class Dense(Blend):
    """Blends all strokes at all pixels in plain PyTorch, with any dtype: slow, simple, and the reference for tests."""

    cost = "grows with strokes times pixels"

    def check(self, count: int, size: Size) -> None:
        if count * size[0] * size[1] > LIMIT:
            reason = f"blend=dense would hold {count} strokes at {size[0] * size[1]} pixels each"
            raise UserError(f"{reason}; use blend=tiled, or fewer strokes or a smaller resolution")

    def __call__(
        self, layers: Layers, front_to_back: Tensor, size: Size, background: Tensor, target: Tensor | None = None
    ) -> Canvas:
        height, width = size
        background, target = match_dtype(layers, background, target)
        self.check(len(front_to_back), size)
        points = pixel_centres(torch.arange(height * width, device=background.device), width, background.dtype)[None]
        alpha, color = layers.sample(front_to_back[None], points)  # (1, N, P), (1, N, P or 1, C)
        paint, light = over(alpha, color)
        image = (paint + light[..., None] * background)[0].T.reshape(-1, height, width)
        if target is None:
            return Canvas(image)
        goal = target.reshape(3, -1).T[None, None]  # (1, 1, P, 3)
        with torch.no_grad():
            error = (alpha * (color - goal).square().sum(-1)).sum((0, 2))
            accuracy = torch.empty_like(error).index_copy_(0, front_to_back, accuracy_of(error, alpha.sum((0, 2))))
        return Canvas(image, accuracy)


def over(alpha: Tensor, color: Tensor) -> tuple[Tensor, Tensor]:
    """Composite K strokes, top stroke first ("over", Porter and Duff, 1984).

    From ``alpha`` (T, K, P) and ``color`` (T, K, P or 1, C), it returns the picture (T, P, C) and the fraction (T, P)
    of light that reaches the background.
    """
    light = torch.cumprod(1 - alpha, dim=1)
    above = torch.cat([torch.ones_like(light[:, :1]), light[:, :-1]], dim=1)
    paint = ((above * alpha)[..., None] * color).sum(1)
    return paint, light[:, -1] if alpha.shape[1] else torch.ones_like(alpha[:, :0].sum(1))
