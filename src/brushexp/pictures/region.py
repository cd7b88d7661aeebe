"""Crop, widen and tile rectangles of the canvas."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from torch import Tensor


@dataclass(frozen=True)
class Region:
    """A rectangle of the canvas, in pixels."""

    top: int
    left: int
    height: int
    width: int

    @staticmethod
    def whole(picture: Tensor) -> Region:
        """Return the region that covers a whole picture (..., H, W)."""
        return Region(0, 0, picture.shape[-2], picture.shape[-1])

    def of(self, picture: Tensor) -> Tensor:
        """Crop this region (..., height, width) from a picture (..., H, W) without copying."""
        return picture[..., self.top : self.top + self.height, self.left : self.left + self.width]

    def widened(self, margin: int, size: tuple[int, int], grid: int = 1) -> Region:
        """Return the region with ``margin`` more pixels on every side, clipped to a canvas of ``size`` (H, W).

        The new region starts at multiples of ``grid``, and its sides have the same remainders modulo ``grid`` as the
        sides of the canvas, so that a network with this stride pads both in the same way.
        """

        def span(first: int, length: int, side: int) -> tuple[int, int]:
            begin, end = max(first - margin, 0) // grid * grid, first + length + margin
            return begin, min(end + (side - end) % grid, side) - begin

        (top, height), (left, width) = span(self.top, self.height, size[0]), span(self.left, self.width, size[1])
        return Region(top, left, height, width)

    def tiles(self, side: int) -> Iterator[Region]:
        """Divide the region into parts of at most ``side`` x ``side`` pixels."""
        for top in range(self.top, self.top + self.height, side):
            for left in range(self.left, self.left + self.width, side):
                height, width = self.top + self.height - top, self.left + self.width - left
                yield Region(top, left, min(side, height), min(side, width))
