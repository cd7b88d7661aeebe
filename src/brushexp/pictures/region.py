"""A rectangle of the canvas."""

from __future__ import annotations

from dataclasses import dataclass

from torch import Tensor


@dataclass(frozen=True)
class Region:
    """A rectangle of the canvas, pixels."""

    top: int
    left: int
    height: int
    width: int

    def of(self, picture: Tensor) -> Tensor:
        """This part (..., height, width) of a picture (..., H, W), not copied."""
        return picture[..., self.top : self.top + self.height, self.left : self.left + self.width]

    def widened(self, margin: int, size: tuple[int, int]) -> Region:
        """With ``margin`` more pixels on every side, as far as a canvas of ``size`` (H, W) reaches."""
        top, left = max(self.top - margin, 0), max(self.left - margin, 0)
        bottom, right = (
            min(self.top + self.height + margin, size[0]),
            min(self.left + self.width + margin, size[1]),
        )
        return Region(top, left, bottom - top, right - left)
