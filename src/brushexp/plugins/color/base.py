"""The contract of colour spaces, in which paint is laid over paint."""

from abc import ABC, abstractmethod
from typing import ClassVar

from torch import Tensor


class ColorSpace(ABC):
    """The numbers in which paint is laid over paint: out = sum_n a_n c_n prod_{i above n} (1 - a_i) in each channel.

    A stroke's colour is brought into C channels, and the finished picture back from them; all between is the same for
    every space. In each channel black is 0 and white is 1: so whatever mixes a colour with white or black, as the light
    of textured strokes does, works in every space. The two are differentiable and each other's inverse, so that opaque
    paint has its own colour.

    >>> import torch
    >>> class Squared(ColorSpace):
    ...     def encode(self, color):
    ...         return color.square()
    ...     def decode(self, picture):
    ...         return picture.clamp_min(1e-6).sqrt()
    >>> red, half = Squared().encode(torch.tensor([[1.0, 0.0, 0.0]])), torch.full((3, 1, 1), 0.5)
    >>> Squared().decode(half * red.T[..., None]).flatten().tolist()  # red over black, half opaque
    [0.7071067690849304, 0.0010000000474974513, 0.0010000000474974513]
    """

    cost: ClassVar[str] = "not measured"  # time of a step, that of ``rgb`` being 1, at 1024 px and 10,000 strokes
    mixes: ClassVar[str] = "as its channels say"  # what half of yellow and half of blue make

    is_rgb: ClassVar[bool] = False  # whether channels are the colours as they come

    @classmethod
    def facts(cls) -> dict[str, str]:
        return {"cost": cls.cost, "yellow over blue": cls.mixes}

    @abstractmethod
    def encode(self, color: Tensor) -> Tensor:
        """Convert colours (..., 3), display-referred (sRGB values) in [0, 1], to channels (..., C) in [0, 1]."""

    @abstractmethod
    def decode(self, picture: Tensor) -> Tensor:
        """Convert a picture in channels (C, H, W) to display-referred RGB (3, H, W) in [0, 1]."""
