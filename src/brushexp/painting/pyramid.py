"""The target at its own size, or at a smaller one for the first steps."""

from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn import functional

from brushexp.pictures.focus import resized


@dataclass(frozen=True)
class PyramidLevel:
    """A target, and how much smaller it is than the canvas that the strokes are measured on.

    Attributes:
        target: (3, H, W) in [0, 1].
        focus: (H, W) how much each pixel counts, of mean 1; None for all alike.
        zoom: its size in sizes of the canvas.
    """

    target: Tensor
    focus: Tensor | None
    zoom: float = 1.0

    @property
    def size(self) -> tuple[int, int]:
        """Height and width in pixels."""
        return int(self.target.shape[1]), int(self.target.shape[2])

    def error(self, image: Tensor) -> float:
        """Mean squared error of a picture (3, H, W) of this size."""
        return float((image - self.target).square().mean())

    def smaller(self, zoom: float) -> "PyramidLevel":
        """The same at ``zoom`` times its size, by means over areas."""
        size = (max(1, round(self.size[0] * zoom)), max(1, round(self.size[1] * zoom)))
        target = functional.interpolate(self.target[None], size, mode="area")[0].contiguous()
        return PyramidLevel(
            target, None if self.focus is None else resized(self.focus, size).contiguous(), self.zoom * zoom
        )


@torch.no_grad()
def enlarged(picture: Tensor, size: tuple[int, int]) -> Tensor:
    """A picture (3, h, w) at ``size`` (H, W); itself if that is its size."""
    if picture.shape[1:] == size:
        return picture
    return functional.interpolate(picture[None], size, mode="bilinear", align_corners=False)[0]
