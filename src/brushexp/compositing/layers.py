"""Define stroke layers, the compiled kernel for a type of layer, and the canvas that a blend produces."""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from typing import Any, ClassVar, Self

import torch
from torch import Tensor

from brushexp.compat.compiled import Compiled
from brushexp.compositing.nearest import find_nearest, recall_nearest
from brushexp.compositing.passes import backward_pass, forward_pass
from brushexp.compositing.scratch import channel_rows

Size = tuple[int, int]  # height and width of a canvas, pixels
SPREAD = 1.5  # half widths that textures extend to either side of the curve and beyond its ends
PAINT_REACH = 2.0  # no stroke paints beyond this many half widths plus SOFT_EDGE pixels: hairs fray beyond textures
SOFT_EDGE = 2.0  # pixels that a soft edge adds to a stroke at most, unless a renderer states another number
Encode = Callable[[Tensor], Tensor]  # from RGB (..., 3) to channels (..., C), black to 0 and white to 1, differentiable
Part = Callable[..., Any]  # a function marked by `system.compiled.inline`


class TileKernel:
    """The compiled passes for a type of layer, built from parts that correspond to the functions in `passes`.

    Args:
        rows: number of rows of ``own``, to which ``rows_per_channel`` are added for each channel. The skeleton uses row
            ABOVE, and row NEAREST if ``curved``.
        temporary: number of scratch rows for use within a part.
        curved: whether to find the nearest points first. The first six numbers of a stroke are then the coordinates of
            its control points in pixels: x and y of start, control and end.
        columns: number of columns that ``pull`` writes; None for one column for each of a stroke's numbers.
        gather: function that computes gradients from the output of ``pull``. Its arguments are ``pairs``, ``there``,
            ``row`` and ``order`` (of the tile lists), the picture's gradient, the strokes' numbers and ``data``. If it
            is None, the output is summed per stroke, which gives the gradient of the strokes' numbers.
        constants: global variables of the parts, by name.
    """

    def __init__(
        self, *, rows: int, cover: Part, tint: Part, shade: Part, tone: Part, pull: Part,
        rows_per_channel: int = 0, temporary: int = 1, curved: bool = True, columns: int | None = None,
        gather: Callable[..., Any] | None = None, **constants: Any,
    ) -> None:  # fmt: skip
        parts: dict[str, Any] = {"cover": cover, "tint": tint, "shade": shade, "tone": tone, "TEMPORARY": temporary}
        parts |= constants | ({"seek": find_nearest, "recall": recall_nearest} if curved else {})
        self._parts, self._pull, self._rows = parts, pull, (rows, rows_per_channel)
        self.columns, self.curved, self.gather = columns, curved, gather

    @cache  # noqa: B019  (kernels live as long as the program)
    def passes(self, channels: int) -> tuple[Compiled, Compiled]:
        """Compile, for ``channels`` channels, the forward pass and the pass for stroke gradients or importance."""
        rows = self._rows[0] + self._rows[1] * channels
        parts = self._parts | channel_rows(channels) | {"ROWS": rows}
        return forward_pass.with_parts(**parts), backward_pass.with_parts(**parts, pull=self._pull)


@dataclass(frozen=True)
class KernelInput:
    """Layers in the form that a compiled kernel reads: float32, on the CPU."""

    kernel: TileKernel
    strokes: Tensor  # (N, .) numbers of each stroke, differentiable
    data: tuple[Any, ...] = ()  # any other data for the parts of the kernel; tensors are passed as arrays
    learnt: int = 0  # how many of the first entries of ``data`` are differentiable
    boxes: tuple[Tensor, Tensor] | None = None  # curve (N, 3, 2) and reach (N,) of strokes that fill boxes


class Layers(ABC):
    """Base class for stroke layers: the curves and reach of N strokes, and their alpha and colour at any point."""

    curve: Tensor  # (N, 3, 2) control points in pixels; a stroke lies entirely within ``reach`` of its curve
    reach: Tensor  # (N,) pixels beyond which alpha is exactly 0; 0 or less for a stroke that covers nothing
    color: Tensor  # (N, C) mean colour
    per_stroke: ClassVar[tuple[str, ...]]  # names of the fields that have one row per stroke

    def joined(self, other: Self) -> Self:
        """Append the strokes in ``other``, layers drawn by the same renderer."""
        rows = {name: torch.cat([getattr(self, name), getattr(other, name)]) for name in self.per_stroke}
        return replace(self, **rows)  # type: ignore[type-var]

    @abstractmethod
    def sample(self, index: Tensor, points: Tensor) -> tuple[Tensor, Tensor]:
        """Evaluate alpha (T, K, P) and colour (T, K, P or 1, C) at ``points`` (T, P, 2).

        ``index`` (T, K) holds the indices of the strokes. Alpha and colour are in [0, 1] and differentiable with
        respect to all fields. If the colour is constant, its pixel axis has length 1.
        """

    def pictures(self, side: int) -> Tensor:
        """Draw each stroke by itself on ``side`` x ``side`` pixels: (N, C + 1, side, side), straight alpha last."""
        pixel = torch.arange(side).to(self.curve) + 0.5
        points = torch.stack(torch.meshgrid(pixel, pixel, indexing="xy"), dim=-1).reshape(1, -1, 2)
        n = len(self.curve)
        index = torch.arange(n, device=points.device)[:, None]
        alpha, color = self.sample(index, points.expand(n, -1, -1))  # (N, 1, P), (N, 1, P or 1, C)
        parts = torch.cat([color.expand(*alpha.shape, color.shape[-1]), alpha[..., None]], dim=-1)
        return parts.reshape(n, side, side, -1).movedim(-1, 1)

    def encoded(self, encode: Encode) -> "Layers":
        """Encode the colours into other channels, in which a texture's tone then mixes them with white or black."""
        return EncodedLayers(self, encode)

    def compiled(self) -> KernelInput | None:
        """Prepare the input of a compiled kernel; return None if no kernel can draw these layers."""
        return None


@dataclass(frozen=True)
class Canvas:
    """The result of a blend: ``image`` (3, H, W) in display-referred RGB and, if there is a target, ``accuracy`` (N,).

    Accuracy, which is defined in ``order.base.Order.depth``, has no gradient; it is NaN for a stroke that does not
    cover any of the picture.
    """

    image: Tensor
    accuracy: Tensor | None = None


Compose = Callable[[Layers, Tensor, Size, Tensor], Canvas]  # as `Blend`, without a target


def accuracy_of(error: Tensor, total: Tensor) -> Tensor:
    """Compute accuracy (N,) from sums (N,) of alpha |color - target|^2 and of alpha; NaN where alpha sums to 0."""
    covers = total > 1e-6  # less than a millionth of a pixel is too little to judge
    return torch.where(covers, 1 - error / total.clamp_min(1e-6), torch.nan)


class EncodedLayers(Layers):
    """Layers of any type whose colours are encoded on sampling."""

    def __init__(self, layers: Layers, encode: Encode) -> None:
        self.layers, self.encode = layers, encode
        self.curve, self.reach, self.color = layers.curve, layers.reach, encode(layers.color)

    def sample(self, index: Tensor, points: Tensor) -> tuple[Tensor, Tensor]:
        alpha, color = self.layers.sample(index, points)
        return alpha, self.encode(color)
