"""An example of a loss in one file: ``'loss=[mse,edges]'``."""

import torch
from torch import Tensor
from torch.nn import functional

from brushexp.contracts import register
from brushexp.contracts.families import Loss, PaintedView


def slopes(image: Tensor) -> Tensor:
    """Compute the differences (2, 3, H, W) between each pixel and its right and lower neighbours; 0 at the border."""
    padded = functional.pad(image[None], (0, 1, 0, 1), mode="replicate")[0]
    return torch.stack([padded[:, :-1, 1:] - image, padded[:, 1:, :-1] - image])


@register("loss", "edges")
class EdgeLoss(Loss):
    """Mean absolute difference between the slopes of two pictures; rewards strokes that end at the target's edges."""

    weight = 0.5
    cost = "1.3 x mse"
    context = 1  # pixels around a part of the canvas that its loss also depends on

    def forward(self, view: PaintedView) -> Tensor:
        return view.mean((slopes(view.image) - slopes(view.target)).abs())
