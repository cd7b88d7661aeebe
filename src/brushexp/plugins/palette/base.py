"""Base class for palettes, which choose the colours of the painting."""

from abc import ABC, abstractmethod
from typing import ClassVar

from torch import Tensor


class Palette(ABC):
    """Maps the colours of a picture to those of the target, as a painter translates a scene into paint.

    >>> import torch
    >>> class Grey(Palette):
    ...     def __call__(self, picture):
    ...         return picture.mean(0).expand(3, -1, -1)
    >>> Grey()(torch.rand(3, 4, 6)).shape
    torch.Size([3, 4, 6])
    """

    has_hues: ClassVar[bool] = True  # whether colours of the picture, such as those of lips, keep their hues

    @abstractmethod
    def __call__(self, picture: Tensor) -> Tensor:
        """Map a picture (3, H, W), display-referred RGB in [0, 1], to a target of the same shape and range."""
