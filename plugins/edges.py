"""A loss in one file: ``'loss=[mse,edges]'``."""

import torch
from torch import Tensor
from torch.nn import functional

from brushexp.contracts import register
from brushexp.contracts.families import Loss, PaintedView


def slopes(image: Tensor) -> Tensor:
    """Differences to the right and to the lower neighbour, 0 at the border: (3, H, W) -> (2, 3, H, W)."""
    padded = functional.pad(image[None], (0, 1, 0, 1), mode="replicate")[0]
    return torch.stack([padded[:, :-1, 1:] - image, padded[:, 1:, :-1] - image])


@register("loss", "edges")
class EdgeLoss(Loss):
    """Mean absolute difference of the slopes of the two pictures: rewards strokes that end where the target changes."""

    weight = 0.5
    cost = "1.3 x mse"
    context = 1  # pixel: a part of the canvas is looked at with its neighbours

    def forward(self, view: PaintedView) -> Tensor:
        return view.mean((slopes(view.image) - slopes(view.target)).abs())
