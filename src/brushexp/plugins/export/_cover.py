"""What can be seen of strokes that lie over each other, on a grid of cells."""

from collections.abc import Iterator

import numpy as np
import shapely
from PIL import Image, ImageDraw

Array = np.ndarray

SEEN = 0.5  # of the light: what lies below more than this cannot be told from what is not there


class Cover:
    """How much of the ground shows through the strokes that have been laid on it, from the top down, and their picture.

    Args:
        corner: upper left corner of the grid, as x + iy.
        size: of the grid, as width + i height.
        cell: side of a cell, in the same unit.
    """

    def __init__(self, corner: complex, size: complex, cell: float) -> None:
        self.corner = corner
        self.cell = cell
        self.light = np.ones((max(1, round(size.imag / cell)), max(1, round(size.real / cell))), dtype=np.float32)
        self.picture = np.zeros((*self.light.shape, 3), dtype=np.float32)  # so far, as the light in which it is seen

    def outlines(self, ways: list[Array], half_widths: Array) -> Array:
        """Outlines (N,), in cells, of strokes with round ends along polylines, as far as they are on the grid."""
        if not ways:
            return np.empty(0, dtype=object)
        points = (np.concatenate(ways) - self.corner) / self.cell
        owner = np.repeat(np.arange(len(ways)), [len(way) for way in ways])
        lines = shapely.linestrings(np.stack([points.real, points.imag], axis=1), indices=owner)
        height, width = self.light.shape
        outlines: Array = shapely.clip_by_rect(shapely.buffer(lines, half_widths / self.cell), 0, 0, width, height)
        return outlines

    def under(self, outline: shapely.Geometry) -> tuple[tuple[slice, slice], Array]:
        """The window of the grid in which an outline lies (not an empty one), and which cells (h, w) are in it."""
        height, width = self.light.shape
        left, top, right, bottom = outline.bounds
        rows = slice(min(int(top), height - 1), max(1, min(int(np.ceil(bottom)), height)))
        columns = slice(min(int(left), width - 1), max(1, min(int(np.ceil(right)), width)))
        picture = Image.new("1", (columns.stop - columns.start, rows.stop - rows.start))
        draw = ImageDraw.Draw(picture)
        for polygon in _polygons(outline):
            for inside, ring in enumerate([polygon.exterior, *polygon.interiors]):
                corners = shapely.get_coordinates(ring) - (columns.start + 0.5, rows.start + 0.5)  # cells by centre
                draw.polygon(corners.ravel().tolist(), fill=0 if inside else 1)
        return (rows, columns), np.array(picture, dtype=bool)

    def shows(self, window: tuple[slice, slice], mask: Array) -> bool:
        """Whether anything can be seen of a stroke that is laid below those that are there."""
        return not mask.any() or bool(self.light[window][mask].max() > SEEN)

    def lay(self, window: tuple[slice, slice], mask: Array, color: Array, opacity: float) -> Array:
        """Lay a stroke of one colour (3,) below those that are there, and return in which cells (K,) it can be seen."""
        light = self.light[window][mask]
        self.picture[window][mask] += (opacity * light)[:, None] * color
        self.light[window][mask] = (1 - opacity) * light
        row, column = np.nonzero(mask)
        cells: Array = (row + window[0].start) * self.light.shape[1] + column + window[1].start
        return cells[light > SEEN]

    def colors(self, cells: list[Array], background: Array) -> Array:
        """Mean colours (N, 3) of the picture in some cells each; black for none."""
        picture = (self.picture + self.light[..., None] * background).reshape(-1, 3)
        return np.array([picture[some].mean(0) if len(some) else np.zeros(3) for some in cells]).reshape(-1, 3)

    def pieces(self, way: Array, least: float) -> list[Array]:
        """The parts of a polyline that can be seen, cut at most half a cell beside where they end.

        Args:
            way: (M,) points.
            least: gaps that are shorter are kept, and then parts that are shorter are dropped.
        """
        nodes, corner = _dense(way, 0.5 * self.cell)
        middles = (nodes[:-1] + nodes[1:]) / 2
        place = (middles - self.corner) / self.cell
        height, width = self.light.shape
        row = np.clip(place.imag.astype(int), 0, height - 1)
        column = np.clip(place.real.astype(int), 0, width - 1)
        seen = self.light[row, column] > SEEN
        if seen.all():
            return [way]
        along = np.concatenate([[0.0], np.abs(np.diff(nodes)).cumsum()])
        return [
            nodes[start : stop + 1][corner[start : stop + 1] | _ends(stop + 1 - start)]
            for start, stop in _runs(seen, along, least)
        ]


def _runs(seen: Array, along: Array, least: float) -> Iterator[tuple[int, int]]:
    """First and last node of each part that is seen, without short gaps and short parts."""
    change = np.flatnonzero(np.diff(np.concatenate([[False], seen, [False]]).astype(np.int8)))
    starts, stops = change[::2], change[1::2]
    if len(starts) == 0:
        return
    wide = along[starts[1:]] - along[stops[:-1]] >= least
    for start, stop in zip(starts[np.r_[True, wide]], stops[np.r_[wide, True]], strict=True):
        if along[stop] - along[start] >= least:
            yield int(start), int(stop)


def _dense(way: Array, step: float) -> tuple[Array, Array]:
    """A polyline with points at most ``step`` apart, and which of them are its own."""
    legs = np.diff(way)
    count = np.maximum(1, np.ceil(np.abs(legs) / step)).astype(int)
    first = np.cumsum(count) - count
    leg = np.repeat(np.arange(len(legs)), count)
    within = (np.arange(len(leg)) - first[leg]) / count[leg]
    return np.append(way[leg] + within * legs[leg], way[-1]), np.append(within == 0, True)


def _ends(count: int) -> Array:
    """True at both ends."""
    ends = np.zeros(count, dtype=bool)
    ends[[0, -1]] = True
    return ends


def _polygons(outline: shapely.Geometry) -> list[shapely.Polygon]:
    parts = shapely.get_parts(outline)
    return [part for part in parts if isinstance(part, shapely.Polygon) and not part.is_empty]
