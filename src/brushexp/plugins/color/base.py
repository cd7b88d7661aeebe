"""Base class for colour spaces, in which paint is composited."""

from abc import ABC, abstractmethod
from typing import ClassVar

from torch import Tensor


class ColorSpace(ABC):
    """A colour space for compositing paint: out = sum_n a_n c_n prod_{i above n} (1 - a_i) in each channel.

    Stroke colours are encoded as C channels, paint is mixed in these channels, and the finished picture is decoded from
    them; the mixing is the same in every space. In each channel, black is 0 and white is 1, so that every space can mix
    a colour with white or black, as textured strokes require. Encoding and decoding are differentiable and inverses of
    each other, so that opaque paint keeps its colour.

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

    cost: ClassVar[str] = "not measured"  # time of a step relative to ``rgb``, at 1024 px and 10,000 strokes
    mixes: ClassVar[str] = "as its channels say"  # mixture of equal parts of yellow and blue

    is_rgb: ClassVar[bool] = False  # whether the channels are the colours themselves

    @classmethod
    def facts(cls) -> dict[str, str]:
        return {"cost": cls.cost, "yellow over blue": cls.mixes}

    @abstractmethod
    def encode(self, color: Tensor) -> Tensor:
        """Convert colours (..., 3), display-referred (sRGB values) in [0, 1], to channels (..., C) in [0, 1]."""

    @abstractmethod
    def decode(self, picture: Tensor) -> Tensor:
        """Convert a picture in channels (C, H, W) to display-referred RGB (3, H, W) in [0, 1]."""
