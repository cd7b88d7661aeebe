"""What every initialiser receives and returns."""

from abc import ABC, abstractmethod

import torch
from torch import Tensor

from brushexp.strokes.catalogue import Strokes


class Initializer(ABC):
    """Places the first strokes.

    Attributes:
        focus: (H, W) how much each pixel of the target counts, of mean 1; None for all alike. It is set before a call;
            an initialiser may leave it aside.
    """

    focus: Tensor | None = None

    @abstractmethod
    def __call__(self, target: Tensor, n_strokes: int, generator: torch.Generator) -> Strokes:
        """Map a target (3, H, W) in [0, 1] to exactly ``n_strokes`` (1 to H * W) strokes, float32 on the CPU.

        All randomness comes from ``generator``.
        """
