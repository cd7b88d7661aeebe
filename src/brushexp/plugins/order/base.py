"""Base class for orders, which decide which strokes are on top of others."""

from abc import ABC, abstractmethod

import torch
from torch import Tensor

from brushexp.strokes.catalogue import Strokes

ONCE = 2**31  # ``every`` of an order that is computed only at the start
RENEWED_SHARE = 0.5  # default share of a stage's steps after which the order is fixed


class Order(ABC):
    """Decides which strokes are on top of others; depth is not a parameter, but is computed without a gradient.

    After a fraction ``until`` of a stage's steps, the order is fixed, because strokes whose rank changes late do not
    recover (this cost up to 1.4 dB in a run of 60 steps).

    >>> class Brightest(Order):
    ...     every, until = 10, 0.5
    ...     def depth(self, strokes, accuracy):
    ...         return strokes.color.mean(1)
    >>> [step for step in range(60) if Brightest().due(step, 60)], Brightest().due(0, 1)
    ([0, 10, 20], True)
    """

    every: int  # number of steps between two computations, as long as `due` allows them
    until: float = RENEWED_SHARE
    needs_accuracy: bool = False  # whether ``depth`` uses ``accuracy``, which the blend then measures in the same pass

    @classmethod
    def facts(cls) -> dict[str, str]:
        return {"cost": "a tenth of a step" if cls.needs_accuracy else "none", "needs": "accuracy" * cls.needs_accuracy}

    @abstractmethod
    def depth(self, strokes: Strokes, accuracy: Tensor | None) -> Tensor:
        """Compute the height (N,) of each stroke; higher strokes are on top and, among equals, later ones.

        ``accuracy`` (N,) is 1 - (sum over pixels of alpha |color - target|^2) / (sum of alpha), where alpha is the
        stroke's own alpha, whether hidden or not. It is None before the first step or if it is not needed.
        """

    def due(self, done: int, steps: int) -> bool:
        """Return whether to recompute the depth after ``done`` of a stage's ``steps`` steps; True at the start."""
        return done % self.every == 0 and (done == 0 or done < self.until * steps)


def front_to_back(depth: Tensor) -> Tensor:
    """Return the indices (N,) that sort strokes by depth, top stroke first; of equal strokes, the later is on top."""
    return len(depth) - 1 - torch.argsort(depth.flip(0), descending=True, stable=True)
