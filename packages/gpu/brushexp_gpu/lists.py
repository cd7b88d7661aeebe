"""Which strokes touch which tile, by sorting on the device: pairs are made by stroke, and sorted by tile.

The only number that the processor waits for is that of all tiles in the boxes of strokes, for which room is made.
"""

from dataclasses import dataclass

import torch
from torch import Tensor

from brushexp.compositing.layers import Size
from brushexp.compositing.tile_lists import TILE
from brushexp_gpu.launch import launch
from brushexp_gpu.list_kernels import box_kernel, find_kernel

CHUNK = 32  # strokes of a tile's list that the way back visits one after the other
BLOCK = 128  # strokes or pairs of a program


@dataclass(frozen=True)
class Lists:
    """The pairs of one canvas, in room for more: those of tiles in a stroke's box that it does not touch come last."""

    first: Tensor  # (tiles + 1,) where each tile's list begins in ``stroke``, ``slot`` and ``part``; row by row
    stroke: Tensor  # (room,) number of the stroke, front to back within a tile
    slot: Tensor  # (room,) the pair's place when pairs are sorted by stroke
    part: Tensor  # (room,) int32, the part of the curve that is near the tile; see `find_kernel`
    space: Tensor  # (N + 1,) where each stroke's slots begin, by depth
    chunks: Tensor  # (tiles + 1,) where each tile's chunks of CHUNK strokes begin
    shape: Size  # tile rows and columns

    @property
    def chunk_room(self) -> int:
        """How many chunks there are at most."""
        return len(self.first) - 1 + len(self.stroke) // CHUNK

    def chunk_tile(self) -> Tensor:
        """Find the tile (chunk_room,) of each chunk; those that there are not have any."""
        chunk = torch.arange(self.chunk_room, device=self.chunks.device)
        return (torch.searchsorted(self.chunks, chunk, right=True) - 1).clamp_max(len(self.chunks) - 2)


def tile_lists(curve: Tensor, reach: Tensor, front_to_back: Tensor, size: Size) -> Lists:
    """List the strokes that may touch each tile of a canvas; arguments as of `brushexp.compositing.tile_lists`."""
    curve, reach, n = curve.contiguous(), reach.contiguous(), len(front_to_back)
    rows, columns = -(-size[0] // TILE), -(-size[1] // TILE)
    boxes = torch.empty((4, n), dtype=torch.int32, device=curve.device)
    launch(box_kernel, -(-n // BLOCK), curve, reach, front_to_back, boxes, n, rows, columns, BLOCK=BLOCK)
    space = _places(boxes[3])
    room = int(space[-1])  # waits for the device
    owner = torch.repeat_interleave(torch.arange(n, device=curve.device), boxes[3], output_size=room)
    tile, part = (torch.empty(room, dtype=torch.int32, device=curve.device) for _ in range(2))
    stroke = torch.empty_like(owner)
    pairs = curve, reach, front_to_back, boxes, space, owner, tile, stroke, part, n, room, rows * columns, columns
    launch(find_kernel, -(-room // BLOCK), *pairs, BLOCK=BLOCK)
    tile, slot = torch.sort(tile, stable=True)
    first = torch.searchsorted(tile, torch.arange(rows * columns + 1, dtype=torch.int32, device=tile.device))
    chunks = _places((first.diff() + CHUNK - 1) // CHUNK)
    return Lists(first, stroke[slot], slot, part[slot], space, chunks, (rows, columns))


def _places(counts: Tensor) -> Tensor:
    """Where each begins (n + 1,) if there are so many of each (n,)."""
    return torch.cat([counts.new_zeros(1, dtype=torch.int64), counts.cumsum(0)])
