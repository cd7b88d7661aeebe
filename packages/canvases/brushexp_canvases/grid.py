"""Divide a canvas into tiles and define the order in which they are painted."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from brushexp.contracts.pictures import Region


@dataclass(frozen=True, order=True)
class Tile:
    """A tile, identified by its row and column in the grid."""

    row: int
    column: int

    @property
    def round(self) -> int:
        """Round, 0 to 3, in which the tile is painted; tiles in the same round do not touch."""
        return 2 * (self.row % 2) + self.column % 2


@dataclass(frozen=True)
class Grid:
    """Square tiles of ``side`` pixels on a canvas of ``size`` (H, W), cropped at the right and bottom edges.

    A tile is painted in its window, which extends ``margin`` pixels beyond the tile on each side, within the canvas.
    The windows of tiles in the same round do not overlap, so these tiles are independent.

    >>> grid = Grid((100, 70), side=40, margin=8)
    >>> grid.shape, grid.region(Tile(2, 1)), grid.window(Tile(2, 1))
    ((3, 2), Region(top=80, left=40, height=20, width=30), Region(top=72, left=32, height=28, width=38))
    >>> list(grid.before(Tile(1, 1)))
    [Tile(row=0, column=0), Tile(row=0, column=1), Tile(row=1, column=0), Tile(row=2, column=0), Tile(row=2, column=1)]
    """

    size: tuple[int, int]  # height and width in pixels
    side: int
    margin: int  # margin in pixels, at most half a side

    @property
    def shape(self) -> tuple[int, int]:
        """Numbers of rows and columns of tiles."""
        return -(-self.size[0] // self.side), -(-self.size[1] // self.side)

    def tiles(self) -> list[Tile]:
        """List all tiles, round by round."""
        rows, columns = self.shape
        tiles = [Tile(row, column) for row in range(rows) for column in range(columns)]
        return sorted(tiles, key=lambda tile: (tile.round, tile))

    def region(self, tile: Tile) -> Region:
        """Return the region of the canvas that a tile covers."""
        return Region(tile.row * self.side, tile.column * self.side, self.side, self.side).widened(0, self.size)

    def window(self, tile: Tile) -> Region:
        """Return the region of the canvas that is used to paint a tile: the tile and its margin."""
        return self.region(tile).widened(self.margin, self.size)

    def tiles_in(self, region: Region) -> Iterator[Tile]:
        """Yield the tiles that overlap a region."""
        for row in range(region.top // self.side, -(-(region.top + region.height) // self.side)):
            for column in range(region.left // self.side, -(-(region.left + region.width) // self.side)):
                yield Tile(row, column)

    def around(self, tile: Tile) -> Iterator[Tile]:
        """Yield the neighbours of a tile, at most eight."""
        return (other for other in self.tiles_in(self.region(tile).widened(1, self.size)) if other != tile)

    def before(self, tile: Tile) -> Iterator[Tile]:
        """Yield the neighbours of a tile that are painted before it."""
        return (other for other in self.around(tile) if other.round < tile.round)

    def near_borders(self, tile: Tile, region: Region, distance: int) -> np.ndarray:
        """Mark the pixels (h, w) in a region around a tile that are within ``distance`` of borders with other tiles.

        >>> Grid((4, 6), side=3, margin=1).near_borders(Tile(0, 0), Region(0, 0, 4, 4), 1).astype(int).tolist()
        [[0, 0, 1, 1], [0, 0, 1, 1], [1, 1, 1, 1], [1, 1, 1, 1]]
        """
        own, marks = self.region(tile), []
        for axis, (first, length, begin, end) in enumerate((
            (region.top, region.height, own.top, own.top + own.height),
            (region.left, region.width, own.left, own.left + own.width),
        )):  # fmt: skip
            borders = np.array([edge for edge in (begin, end) if 0 < edge < self.size[axis]], dtype=float)
            centres = np.arange(first, first + length) + 0.5
            marks.append((np.abs(centres[:, None] - borders) < distance).any(axis=1))
        return marks[0][:, None] | marks[1]
