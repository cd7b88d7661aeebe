"""Base class for brush simulators, which paint single strokes."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

from torch import Tensor


@dataclass(frozen=True)
class Simulated:
    """Pictures and paint heights of n strokes, each on its own canvas."""

    images: Tensor  # (n, 4, S, S) float32 RGBA in [0, 1], straight alpha; pixels without paint have the stroke's colour
    heights: Tensor  # (n, S, S) float32 >= 0, amount of paint; 1 is about enough to cover the canvas


class Engine(ABC):
    """Simulates the mark of one stroke on an empty canvas.

    The points of the curve are in half-windows from the window's centre, so that the edges are at -1 and 1; the width
    is a fraction of the window. An engine with a larger window therefore paints the same strokes larger.

    >>> from brushexp.registry import build_named
    >>> from brushexp.strokes.prior import parameters_of, sample_prior
    >>> simulated = build_named("engine", "disc", {"window": 32})(parameters_of(sample_prior(3)), seed=0)
    >>> simulated.images.shape, simulated.heights.shape
    (torch.Size([3, 4, 32, 32]), torch.Size([3, 32, 32]))
    """

    window: int  # S, pixels on the side of a picture
    has_heights: ClassVar[bool] = False  # whether ``heights`` contains more than alpha
    is_random: ClassVar[bool] = True  # whether two strokes with the same parameters differ

    @classmethod
    def facts(cls) -> dict[str, str]:
        return {
            "height of the paint": "simulated" if cls.has_heights else "alpha",
            "strokes of the same parameters": "differ" if cls.is_random else "are alike",
        }

    @abstractmethod
    def __call__(self, parameters: Tensor, *, seed: int, first: int = 0) -> Simulated:
        """Simulate n strokes, numbered from ``first`` to ``first + n - 1``.

        Each stroke depends only on its parameters, its number and ``seed``, and not on n or the number of threads.
        ``parameters`` (n, 10) in [-1, 1] have the format of `strokes.prior.parameters_of`, but any finite values can be
        simulated; ``seed`` is 0 to 2**64 - 1.
        """
