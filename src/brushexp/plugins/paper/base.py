"""Base class for papers and canvases, on which the strokes are painted."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import torch
from torch import Tensor


@dataclass(frozen=True)
class Rows:
    """A band of ``count`` rows, starting at row ``top``, of a canvas of ``size`` (H, W) in pixels."""

    top: int
    count: int
    size: tuple[int, int]

    @property
    def places(self) -> tuple[Tensor, Tensor]:
        """Return the pixel centres' x and y (count, W), float64, as fractions of the canvas's longer side."""
        side = max(self.size)
        y = (torch.arange(self.top, self.top + self.count, dtype=torch.float64) + 0.5) / side
        x = (torch.arange(self.size[1], dtype=torch.float64) + 0.5) / side
        y, x = torch.meshgrid(y, x, indexing="ij")
        return x, y

    def widened(self, margin: int) -> "Rows":
        """Return the band with up to ``margin`` more rows above and below, clipped to the canvas."""
        first, after = max(self.top - margin, 0), min(self.top + self.count + margin, self.size[0])
        return Rows(first, after - first, self.size)


class Paper(ABC):
    """The surface beneath the strokes; paint skips parts of it, and its relief catches the light.

    The surface is the same at every size of the picture and in every band of rows.

    >>> class Striped(Paper):
    ...     def cover(self, flat, bare, rows):
    ...         return torch.where(rows.places[1] * 8 % 1 < 0.5, flat, bare[:, None, None])
    ...     def relief(self, rows):
    ...         return torch.zeros(rows.count, rows.size[1])
    >>> Striped().cover(torch.zeros(3, 4, 2), torch.ones(3), Rows(0, 4, (16, 2)))[0, :, 0].tolist()
    [0.0, 1.0, 0.0, 1.0]
    """

    is_smooth: ClassVar[bool] = False  # whether strokes look as painted on this paper

    def margin(self, size: tuple[int, int]) -> int:
        """Return how many extra rows `cover` needs above and below a band on a canvas of ``size`` (H, W)."""
        return 0

    @abstractmethod
    def cover(self, flat: Tensor, bare: Tensor, rows: Rows) -> Tensor:
        """Turn a picture of strokes on a smooth ground of colour ``bare`` (3,) into their picture on this paper.

        Both pictures (3, h, W), in [0, 1], cover ``rows``; the result is differentiable in ``flat`` and ``bare``.
        """

    @abstractmethod
    def relief(self, rows: Rows) -> Tensor:
        """Return the paper's height (h, W), float32, at least 0, in pixels of the picture."""
