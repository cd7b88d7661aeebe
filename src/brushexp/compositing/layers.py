"""What passes from renderers to blends: layers, and the compiled kernel of a kind of layer."""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Self

import torch
from torch import Tensor

from brushexp.compositing.nearest import find_nearest, recall_nearest
from brushexp.compositing.passes import backward_pass, forward_pass, weigh

Size = tuple[int, int]  # height and width of a canvas, pixels
SPREAD = 1.5  # half widths that textures reach to either side of the curve, and beyond its ends
EDGE = 2.0  # pixels that a soft edge may add to a stroke
Part = Callable[..., Any]  # a function marked by `system.compiled.inline`


class TileKernel:
    """The compiled passes of a kind of layer, from its parts: see the functions of these names in `passes`.

    Args:
        columns: numbers that ``pull`` writes.
        rows: of ``own``; row ABOVE is the skeleton's, and row NEAREST too if ``curved``.
        temporary: rows for use within a part.
        curved: find nearest points first. The first six numbers of a stroke are then its control points in pixels,
            start, control and end, x and y each.
        gather: makes gradients of what ``pull`` wrote, called with pairs, there, row of the lists, order, gradient of
            the picture, strokes and data; None: they are summed by stroke and are the gradient of the strokes' numbers.
    """

    def __init__(
        self, *, columns: int, rows: int, cover: Part, tint: Part, shade: Part, pull: Part,
        temporary: int = 1, curved: bool = True, gather: Callable[..., Any] | None = None,
    ) -> None:  # fmt: skip
        parts: dict[str, Any] = {"cover": cover, "tint": tint, "shade": shade, "ROWS": rows, "TEMPORARY": temporary}
        if curved:
            parts |= {"seek": find_nearest, "recall": recall_nearest}
        self.columns, self.curved, self.gather = columns, curved, gather
        self.forward = forward_pass.having(**parts)
        self.backward = backward_pass.having(**parts, pull=pull)
        self.importance = backward_pass.having(**parts, visit=weigh)


@dataclass(frozen=True)
class KernelInput:
    """Layers as a compiled kernel takes them: float32, on the CPU.

    ``boxes`` are curve (N, 3, 2) and reach (N,) of strokes that fill the boxes around them; None: those of the layers.
    """

    kernel: TileKernel
    strokes: Tensor  # (N, C) numbers of each stroke, differentiable
    data: tuple[Any, ...] = ()  # whatever else the parts of the kernel need; tensors reach them as arrays
    learnt: int = 0  # how many of ``data``, counted from the first, are differentiable
    boxes: tuple[Tensor, Tensor] | None = None


class Layers(ABC):
    """Coverage of N strokes: their curves, how far they reach, and alpha and colour at any points."""

    curve: Tensor  # (N, 3, 2) control points in pixels; all of a stroke lies within ``reach`` of its curve
    reach: Tensor  # (N,) pixels beyond which its alpha is exactly 0; 0 or less for a stroke that is nowhere
    color: Tensor  # (N, 3) mean colour
    per_stroke: ClassVar[tuple[str, ...]]  # names of the fields that have a row for each stroke

    def joined(self, other: Self) -> Self:
        """These strokes, and then those of ``other``, which the same renderer drew."""
        rows = {name: torch.cat([getattr(self, name), getattr(other, name)]) for name in self.per_stroke}
        return replace(self, **rows)  # type: ignore[type-var]

    @abstractmethod
    def sample(self, index: Tensor, points: Tensor) -> tuple[Tensor, Tensor]:
        """Alpha (T, K, P) and colour (T, K, P or 1, 3) of strokes ``index`` (T, K) at ``points`` (T, P, 2).

        Both are in [0, 1], and differentiable in all fields; a colour that is constant has one pixel.
        """

    def compiled(self) -> KernelInput | None:
        """The same for a compiled kernel; None if there is none, or none that can do what these layers need."""
        return None
