"""A loss in one file: ``'loss=[mse,edges]'``."""

import torch
from torch import Tensor

from brushexp.plugins.loss.base import Loss, Painting
from brushexp.registry import register


def slopes(image: Tensor) -> Tensor:
    """Differences to the right and to the lower neighbour: (3, H, W) -> (2, 3, H-1, W-1)."""
    corner = image[:, :-1, :-1]
    return torch.stack([image[:, :-1, 1:] - corner, image[:, 1:, :-1] - corner])


@register("loss", "edges")
class EdgeLoss(Loss):
    """Mean absolute difference of the slopes of the two pictures: rewards strokes that end where the target changes.

    Args:
        weight: in the sum of losses.
    """

    def __init__(self, *, weight: float = 0.5) -> None:
        super().__init__()
        self.weight = weight

    def forward(self, painting: Painting) -> Tensor:
        difference = (slopes(painting.image) - slopes(painting.target)).abs()
        if painting.focus is not None:  # a slope counts as much as the pixel that it starts from
            difference = difference * painting.focus[:-1, :-1]
        return difference.sum() / max(1, difference.numel())  # a picture of one pixel has no slopes
