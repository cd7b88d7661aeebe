"""What every loss receives and returns."""

from abc import ABC, abstractmethod
from dataclasses import dataclass

from torch import Tensor, nn

from brushexp.strokes.catalogue import Strokes


@dataclass(frozen=True)
class Painting:
    """Everything a loss may look at after one forward pass.

    Attributes:
        image: (3, H, W) the painting, display-referred RGB in [0, 1].
        target: (3, H, W) what it should look like, same units; the same tensor object at every step.
        strokes: the N strokes it is made of.
    """

    image: Tensor
    target: Tensor
    strokes: Strokes


class Loss(nn.Module, ABC):
    """One term of the objective. ``weight`` scales it in the sum; logs show it unweighted."""

    weight: float

    @abstractmethod
    def forward(self, painting: Painting) -> Tensor:
        """Return a scalar, 0 for a perfect painting."""
