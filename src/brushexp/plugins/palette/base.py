"""The contract of palettes, which give the picture the colours in which it is painted."""

from abc import ABC, abstractmethod

from torch import Tensor


class Palette(ABC):
    """Maps the picture to the target of the painting, as a painter translates what he sees into his paints.

    >>> import torch
    >>> class Grey(Palette):
    ...     def __call__(self, picture):
    ...         return picture.mean(0).expand(3, -1, -1)
    >>> Grey()(torch.rand(3, 4, 6)).shape
    torch.Size([3, 4, 6])
    """

    @abstractmethod
    def __call__(self, picture: Tensor) -> Tensor:
        """Map a picture (3, H, W) in [0, 1], display-referred RGB, to the target, of the same kind."""
