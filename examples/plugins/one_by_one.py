"""Blend plugin in a single file: ``blend=one_by_one``."""

import torch
from torch import Tensor

from brushexp.contracts import register
from brushexp.contracts.families import Blend, match_dtype, pixel_centres
from brushexp.contracts.layers import Canvas, Layers, Size, accuracy_of


@register("blend", "one_by_one")
class OneByOne(Blend):
    """Composites strokes one by one over the whole canvas, from bottom to top; other blends are faster."""

    def __call__(
        self, layers: Layers, front_to_back: Tensor, size: Size, background: Tensor, target: Tensor | None = None
    ) -> Canvas:
        height, width = size
        background, target = match_dtype(layers, background, target)
        points = pixel_centres(torch.arange(height * width, device=background.device), width, background.dtype)[None]
        picture = background.expand(height * width, -1)  # (P, C)
        accuracy = torch.zeros(len(front_to_back), dtype=background.dtype, device=background.device)
        for stroke in front_to_back.flip(0):
            alpha, color = layers.sample(stroke[None, None], points)  # (1, 1, P), (1, 1, P or 1, C)
            alpha, color = alpha[0, 0, :, None], color[0, 0]
            picture = alpha * color + (1 - alpha) * picture
            if target is not None:
                error = alpha[:, 0] * (color - target.reshape(3, -1).T).square().sum(-1)
                accuracy[stroke] = accuracy_of(error.sum().detach(), alpha.sum().detach())
        return Canvas(picture.T.reshape(-1, height, width), None if target is None else accuracy)
