"""Base class for initialisers, which place the initial strokes."""

from abc import ABC, abstractmethod

import torch
from torch import Tensor

from brushexp.strokes.catalogue import Strokes


class Initializer(ABC):
    """Places the initial strokes of a painting on its target.

    >>> from brushexp.plugins.init.grid import Grid
    >>> strokes = Grid()(torch.rand(3, 20, 30), 6, torch.Generator().manual_seed(0))
    >>> len(strokes), strokes.color.shape
    (6, torch.Size([6, 3]))
    """

    @abstractmethod
    def __call__(self, target: Tensor, n: int, generator: torch.Generator, focus: Tensor | None = None) -> Strokes:
        """Place exactly ``n`` (1 to H * W) strokes, float32 on the CPU, on a target (3, H, W) in [0, 1].

        All randomness comes from ``generator``. ``focus`` (H, W) holds pixel weights with mean 1; an initialiser may
        ignore it.
        """

    def nearer(self) -> "Initializer":
        """Return the initialiser for faces, which keep their detail while ``abstraction`` simplifies the rest."""
        return self
