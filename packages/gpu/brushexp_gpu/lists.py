"""List the strokes that touch each tile: pairs of a stroke and a tile are generated and sorted by tile on the device.

The CPU has to wait for only one number, the total number of tiles in the strokes' bounding boxes, which determines the
size of the buffers.
"""

from dataclasses import dataclass

import torch
from torch import Tensor

from brushexp.contracts.kernels import TILE
from brushexp.contracts.layers import Size
from brushexp_gpu.launch import launch
from brushexp_gpu.list_kernels import arrange_kernel, box_kernel, find_kernel

CHUNK = 32  # number of strokes of a tile's list that the backward pass visits sequentially
BLOCK = 128  # number of strokes or pairs per program


@dataclass(frozen=True)
class Lists:
    """Pairs of a stroke and a tile of one canvas, sorted by tile; pairs that do not touch each other come last."""

    first: Tensor  # (tiles + 1,) start of each tile's list in ``stroke``, ``slot`` and ``part``; tiles row by row
    stroke: Tensor  # (room,) number of the stroke, front to back within a tile
    slot: Tensor  # (room,) index of the pair when sorted by stroke
    part: Tensor  # (room,) int32, part of the curve near the tile; see `find_kernel`
    space: Tensor  # (N + 1,) start of each stroke's slots, by depth
    chunks: Tensor  # (tiles + 1,) start of each tile's chunks of CHUNK strokes
    shape: Size  # tile rows and columns

    @property
    def chunk_room(self) -> int:
        """Upper bound on the number of chunks."""
        return len(self.first) - 1 + len(self.stroke) // CHUNK


def tile_lists(curve: Tensor, reach: Tensor, front_to_back: Tensor, size: Size) -> Lists:
    """List the strokes that may touch each tile of a canvas, as `brushexp.compositing.tile_lists` does."""
    curve, reach, n = curve.contiguous(), reach.contiguous(), len(front_to_back)
    rows, columns = -(-size[0] // TILE), -(-size[1] // TILE)
    tiles, number = rows * columns, curve.new_empty(0, dtype=torch.int32)
    boxes, sizes = number.new_empty((3, n)), number.new_empty(n + 1)
    launch(box_kernel, n // BLOCK + 1, curve, reach, front_to_back, boxes, sizes, n, rows, columns, BLOCK=BLOCK)
    space = sizes.cumsum(0)
    room = int(space[-1])  # waits for the device
    tile, near, part = (number.new_empty(room) for _ in range(3))
    found, stroke = (space.new_empty(room) for _ in range(2))
    pairs = curve, reach, front_to_back, boxes, space, tile, found, near, n, room, tiles, columns
    launch(find_kernel, -(-room // BLOCK), *pairs, BLOCK=BLOCK)
    tile, slot = torch.sort(tile, stable=True)
    first, sizes = space.new_empty(tiles + 1), number.new_empty(tiles + 1)
    programs = -(-max(room, tiles + 1) // BLOCK)
    parts = tile, slot, found, near, stroke, part, first, sizes, room, tiles
    launch(arrange_kernel, programs, *parts, CHUNK=CHUNK, BLOCK=BLOCK)
    return Lists(first, stroke, slot, part, space, sizes.cumsum(0), (rows, columns))
