"""What every brush simulator receives and returns."""

from abc import ABC, abstractmethod
from dataclasses import dataclass

from torch import Tensor


@dataclass(frozen=True)
class Simulated:
    """What n strokes left behind, each on a canvas of its own.

    Attributes:
        images: (n, 4, S, S) float32 RGBA in [0, 1], straight alpha; where there is no paint, the colour of the stroke.
        heights: (n, S, S) float32 >= 0, how much paint lies there; 1 is about what covers the canvas.
    """

    images: Tensor
    heights: Tensor


class Engine(ABC):
    """Simulates what one stroke leaves on an empty canvas.

    Attributes:
        window: S, pixels on the side of a picture.
    """

    window: int

    @abstractmethod
    def __call__(self, parameters: Tensor, *, seed: int, first: int = 0) -> Simulated:
        """Paint strokes number ``first`` to ``first + n - 1``.

        Stroke i depends on its parameters, ``seed`` and its own number alone: never on n, nor on the number of threads.

        Args:
            parameters: (n, 10) in [-1, 1], as `strokes.prior.parameters_of` writes them; anything finite is drawn.
            seed: 0 to 2**64 - 1, of everything random.
            first: number of the first one.
        """
