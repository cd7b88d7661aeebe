"""A rectangle of the canvas."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from torch import Tensor


@dataclass(frozen=True)
class Region:
    """A rectangle of the canvas, pixels."""

    top: int
    left: int
    height: int
    width: int

    @staticmethod
    def whole(picture: Tensor) -> Region:
        """All of a picture (..., H, W)."""
        return Region(0, 0, picture.shape[-2], picture.shape[-1])

    def of(self, picture: Tensor) -> Tensor:
        """This part (..., height, width) of a picture (..., H, W), not copied."""
        return picture[..., self.top : self.top + self.height, self.left : self.left + self.width]

    def widened(self, margin: int, size: tuple[int, int], grid: int = 1) -> Region:
        """With ``margin`` more pixels on every side, as far as a canvas of ``size`` (H, W) reaches.

        It begins at multiples of ``grid``, and its sides leave the same remainder as those of the canvas: a network
        whose positions are so many pixels apart then pads both alike, and looks at the same places in both.
        """

        def span(first: int, length: int, side: int) -> tuple[int, int]:
            begin, end = max(first - margin, 0) // grid * grid, first + length + margin
            return begin, min(end + (side - end) % grid, side) - begin

        (top, height), (left, width) = span(self.top, self.height, size[0]), span(self.left, self.width, size[1])
        return Region(top, left, height, width)

    def tiles(self, side: int) -> Iterator[Region]:
        """The region in parts of at most ``side`` x ``side`` pixels."""
        for top in range(self.top, self.top + self.height, side):
            for left in range(self.left, self.left + self.width, side):
                height, width = self.top + self.height - top, self.left + self.width - left
                yield Region(top, left, min(side, height), min(side, width))
