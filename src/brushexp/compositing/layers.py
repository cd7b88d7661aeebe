"""What passes from renderers to blends."""

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Self

import torch
from torch import Tensor

from brushexp.compositing.tile_kernel import TileKernel

Size = tuple[int, int]  # height and width of a canvas, pixels
SPREAD = 1.5  # half widths that textures reach to either side of the curve, and beyond its ends
EDGE = 2.0  # pixels that a soft edge may add to a stroke


@dataclass(frozen=True)
class KernelInput:
    """Layers as a compiled kernel takes them: float32, on the CPU.

    Attributes:
        kernel: of this kind of layer.
        strokes: (N, C) numbers of each stroke, differentiable.
        data: whatever else the parts of the kernel need; tensors reach them as arrays.
        learnt: how many of ``data``, counted from the first, are differentiable.
        boxes: curve (N, 3, 2) and reach (N,) of strokes that fill the boxes around them, corners too; None for those of
            the layers, which strokes are within.
    """

    kernel: TileKernel
    strokes: Tensor
    data: tuple[Any, ...] = ()
    learnt: int = 0
    boxes: tuple[Tensor, Tensor] | None = None


class Layers(ABC):
    """Coverage of N strokes: their curves, how far they reach, and alpha and colour at any points.

    Attributes:
        curve: (N, 3, 2) control points in pixels; all of a stroke lies within ``reach`` of its curve.
        reach: (N,) pixels beyond which its alpha is exactly 0; 0 or less for a stroke that is nowhere.
        color: (N, 3) mean colour.
        per_stroke: names of the fields that have a row for each stroke.
    """

    curve: Tensor
    reach: Tensor
    color: Tensor
    per_stroke: ClassVar[tuple[str, ...]]

    def joined(self, other: Self) -> Self:
        """These strokes, and then those of ``other``, which the same renderer drew."""
        rows = {name: torch.cat([getattr(self, name), getattr(other, name)]) for name in self.per_stroke}
        return replace(self, **rows)  # type: ignore[type-var]

    @abstractmethod
    def sample(self, index: Tensor, points: Tensor) -> tuple[Tensor, Tensor]:
        """Alpha and colour of strokes ``index`` (T, K) at ``points`` (T, P, 2), differentiable in all fields.

        Returns:
            alpha (T, K, P) in [0, 1] and color (T, K, P, 3), or (T, K, 1, 3) where it is constant.
        """

    def compiled(self) -> KernelInput | None:
        """The same for a compiled kernel; None if there is none, or none that can do what these layers need."""
        return None
