"""Split a picture of any size into overlapping tiles that can be processed one by one."""

from collections.abc import Iterator
from typing import NamedTuple

from brushexp_recovery.raster.boxes import Box

MARGIN = 64  # width in pixels of the margin around a tile's core


class Tile(NamedTuple):
    """A part of a picture, and its core, which does not overlap the core of any other tile."""

    box: Box
    core: Box


def split_into_tiles(height: int, width: int, zoom: float, side: int, margin: int = MARGIN) -> Iterator[Tile]:
    """Cover a picture with overlapping tiles whose cores do not overlap.

    After zooming, a tile is at most ``side`` pixels wide and extends ``margin`` pixels beyond its core.
    """
    rows, columns = (list(_spans(size, int(side / zoom), int(margin / zoom))) for size in (height, width))
    for (top, bottom), (core_top, core_bottom) in rows:
        for (left, right), (core_left, core_right) in columns:
            yield Tile(Box(top, bottom, left, right), Box(core_top, core_bottom, core_left, core_right))


def _spans(size: int, side: int, margin: int) -> Iterator[tuple[tuple[int, int], tuple[int, int]]]:
    """Split an axis of ``size`` pixels; yield the start and end of each tile, and the start and end of its core."""
    count = 1 if size <= side else -(-size // (side - 2 * margin))
    for number in range(count):
        begin, end = number * size // count, (number + 1) * size // count
        yield (max(begin - margin, 0), min(end + margin, size)), (begin, end)
