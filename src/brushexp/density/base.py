"""What every density policy receives and returns."""

from abc import ABC, abstractmethod
from dataclasses import dataclass

from torch import Tensor

from brushexp.loss.base import Painting
from brushexp.strokes.catalogue import Strokes


@dataclass(frozen=True)
class Revision:
    """A change of the set of strokes.

    Attributes:
        keep: (N,) bool, which of the present strokes stay.
        new: strokes to add.
    """

    keep: Tensor
    new: Strokes


class Density(ABC):
    """Adds strokes where they are needed and removes those that are not."""

    @abstractmethod
    def revise(self, painting: Painting, step: int, n_steps: int) -> Revision | None:
        """Look at the painting after ``step`` (1 to ``n_steps``) and say what changes; None for no change."""
