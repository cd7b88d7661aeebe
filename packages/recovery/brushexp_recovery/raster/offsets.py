"""Find pairs of pixels that are separated by a given offset."""

import torch
from torch import Tensor

Offset = tuple[int, int]  # rows, columns
Slices = tuple[slice, slice]  # slices of rows and columns


def pair_slices(size: tuple[int, ...], offset: Offset) -> tuple[Slices, Slices]:
    """Return slices of the pixels of a picture (H, W) that have a partner at an offset, and slices of the partners.

    The offset must not point upwards. If it is larger than the picture, both pairs of slices are empty.
    """
    (height, width), (dy, dx) = size, offset
    bottom = max(height - dy, 0)
    left = max(0, -dx)
    right = max(width - max(0, dx), left)
    return (slice(0, bottom), slice(left, right)), (slice(dy, dy + bottom), slice(left + dx, right + dx))


def shift(values: Tensor, dy: int, dx: int) -> Tensor:
    """Shift the last two axes by any offset: out[p] = values[p + (dy, dx)], or 0 outside the input."""
    out = torch.zeros_like(values)
    height, width = values.shape[-2:]
    top, bottom = max(0, -dy), height - max(0, dy)
    left, right = max(0, -dx), width - max(0, dx)
    if top < bottom and left < right:
        out[..., top:bottom, left:right] = values[..., top + dy : bottom + dy, left + dx : right + dx]
    return out
