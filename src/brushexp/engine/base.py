"""What every brush simulator receives and returns."""

from abc import ABC, abstractmethod

from torch import Tensor


class Engine(ABC):
    """Simulates what one stroke leaves on an empty canvas."""

    @abstractmethod
    def __call__(self, parameters: Tensor, seed: int) -> Tensor:
        """Map parameters (n, 10) in [-1, 1] to pictures (n, 4, S, S), RGBA in [0, 1].

        Stroke i depends on ``seed`` and i alone, never on n.
        """
