"""What every order receives and returns."""

from abc import ABC, abstractmethod

import torch
from torch import Tensor

from brushexp.errors import UserError
from brushexp.strokes.catalogue import Strokes

SETTLED = 0.5  # share of a stage's steps after which the order stays


class Order(ABC):
    """Decides which stroke lies on top. Depth is not a parameter: it is computed and has no gradient.

    Attributes:
        every: steps between two computations, as long as `due` allows any.
        needs_accuracy: whether ``depth`` reads ``accuracy``; the blend then measures it in the same pass.
    """

    every: int
    needs_accuracy: bool

    @abstractmethod
    def depth(self, strokes: Strokes, accuracy: Tensor | None) -> Tensor:
        """Height (N,) of each stroke: the higher lies on top; of two equal ones, the later.

        ``accuracy`` (N,) is 1 - (sum over pixels of alpha |color - target|^2) / (sum of alpha), where alpha is the
        stroke's own, hidden or not, and |.|^2 sums over RGB; None before the first step, or if it is not needed.
        """

    def due(self, done: int, steps: int) -> bool:
        """Whether the depth is computed anew when ``done`` of a stage's ``steps`` have been taken.

        Not in its second half: strokes that change places are wrong for a while, and when the learning rate has begun
        to fall they no longer recover (up to 1.4 dB lost in a run of 60 steps). Steps that begin a stage count as due.
        """
        return done % self.every == 0 and (done == 0 or done < SETTLED * steps)


def front_to_back(depth: Tensor) -> Tensor:
    """Indices (N,) of strokes, the uppermost first; of two of equal depth the later lies on top."""
    last = len(depth) - 1
    return last - torch.argsort(depth.flip(0), descending=True, stable=True)


def every_or_refuse(every: int) -> int:
    """``every`` itself, if it is a number of steps."""
    if every < 1:
        raise UserError(f"order.every={every} is not a number of steps; use order.every=1 or more")
    return every
