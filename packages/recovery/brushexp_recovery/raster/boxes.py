"""Represent rectangles of pixels."""

from typing import NamedTuple


class Box(NamedTuple):
    """A rectangle of pixels; ``bottom`` and ``right`` are exclusive."""

    top: int
    bottom: int
    left: int
    right: int

    @property
    def size(self) -> tuple[int, int]:
        """Height and width of the box in pixels."""
        return self.bottom - self.top, self.right - self.left

    @property
    def slices(self) -> tuple[slice, slice]:
        """Slices that select the box from the rows and columns of a picture."""
        return slice(self.top, self.bottom), slice(self.left, self.right)

    @property
    def is_empty(self) -> bool:
        """Check whether the box contains no pixels."""
        return self.top >= self.bottom or self.left >= self.right

    def intersection(self, other: "Box") -> "Box":
        """Return the intersection of two boxes."""
        return Box(
            max(self.top, other.top),
            min(self.bottom, other.bottom),
            max(self.left, other.left),
            min(self.right, other.right),
        )

    def within(self, other: "Box") -> "Box":
        """Return the same rectangle in coordinates relative to the top left corner of another box."""
        return Box(self.top - other.top, self.bottom - other.top, self.left - other.left, self.right - other.left)
