"""Draw strokes by bending straight pictures of strokes along curves."""
# mypy: allow-untyped-defs

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from brushexp.contracts.kernels import function
from brushexp_recovery.curves.bezier import points_on
from brushexp_recovery.curves.nearest import length_of_line, nearest_place, unit
from brushexp_recovery.raster.blur import gaussian_blur
from brushexp_recovery.synthesis.hand import Random
from brushexp_recovery.synthesis.layout import StrokeLayout
from brushexp_recovery.synthesis.marks import POINTS, standardise
from brushexp_recovery.synthesis.windows import StrokeWindows, Texel, close_gaps, join_windows, place_windows

Array = NDArray[Any]
F = np.float32

BEYOND_ENDS = 0.3  # extent of a sheet beyond each end of a stroke in widths
BEYOND_SIDES = 0.15  # extent of a sheet beyond each side of a stroke in widths
COLUMNS = 36  # columns of a sheet drawn by a formula
MOST_ROWS = 320
MARGIN = 2.0  # margin around a stroke in pixels
GAP_SHARE = 0.15  # maximum width, as a share of the stroke's, of gaps between specks that belong to its region
NARROWEST_GAP = 5  # lower bound of this width in pixels


@dataclass(frozen=True)
class Sheet:
    """A picture of a straight stroke; rows are numbered along the stroke, and columns across it.

    The picture extends `BEYOND_ENDS` widths beyond each end of the stroke and `BEYOND_SIDES` widths beyond each side.
    """

    cover: Array  # (A, C) coverage of paint in [0, 1]
    tint: Array  # (A, C, 3) factor of the stroke's colour
    height: Array  # (A, C) height of the paint; 1 is full

    def reduce(self, width: float) -> "Sheet":
        """Average blocks of pixels until the resolution suits a stroke of ``width`` pixels; return a float32 sheet."""
        cover, tint, height = (np.ascontiguousarray(each, F) for each in (self.cover, self.tint, self.height))
        while cover.shape[1] > 2.6 * max(width, 4.0) and min(cover.shape) >= 4:
            cover, tint, height = _halve(cover), _halve(tint), _halve(height)
        return Sheet(cover, tint, height)


def _halve(values: Array) -> Array:
    """Average blocks of 2 x 2 pixels."""
    rows, columns = (size // 2 * 2 for size in values.shape[:2])
    blocks = [values[i:rows:2, j:columns:2] for i in range(2) for j in range(2)]
    mean: Array = np.mean(blocks, 0)
    return mean


def places_across(columns: int) -> Array:
    """Return the distances of a sheet's columns from the middle of the stroke, in half widths; negative on one side."""
    return np.linspace(-1 - 2 * BEYOND_SIDES, 1 + 2 * BEYOND_SIDES, columns)


def ends_of(rows: int, length: float) -> Array:
    """Return each row's distance, in widths, from the nearer end of a stroke; it is negative beyond the end."""
    along = np.linspace(-BEYOND_ENDS, length + BEYOND_ENDS, rows)
    return np.minimum(along, length - along)


def smooth_noise(random: Random, size: tuple[int, ...], sigma: Any) -> Array:
    """Sample smooth noise with a mean of 0 and a standard deviation of 1."""
    return standardise(gaussian_blur(random.normal(size=size), sigma))


def draw_bristles(random: Random, rows: int, columns: int) -> Array:
    """Sample paint variations (A, C) that are rapid across the bristles and slow along each bristle."""
    slow = smooth_noise(random, (rows, columns), (0.01 * rows * random.uniform(2, 25), random.uniform(0.3, 1.2)))
    own = smooth_noise(random, (1, columns), (0, random.uniform(0.3, 1.5)))
    share = random.uniform(0.2, 0.9)
    return (1 - share) * slow + share * own


def draw_outline(random: Random, rows: int, columns: int, length: float, rough: float, ends: float) -> Array:
    """Draw the coverage (A, C) of a stroke with rough sides, whose ends narrow over ``ends`` widths.

    ``rough`` is the standard deviation of the positions of the sides, in half widths, and of the bristles' ends, in
    widths.
    """
    across = places_across(columns)
    ragged = rough * smooth_noise(random, (2, columns), (0, random.uniform(0.4, 2)))
    near = (np.arange(rows) * 2 >= rows).astype(int)
    tip = ends_of(rows, length)[:, None] + ragged[near]
    sides = 1 + rough * smooth_noise(random, (rows, 2), (0.01 * rows * random.uniform(2, 12), 0))
    edge = sides[:, (across > 0).astype(int)] * np.sqrt(1 - (1 - np.clip(tip / ends, 0, 1)) ** 2)
    soft = 2.5 / columns
    cover: Array = np.clip((edge - np.abs(across)) / soft + 0.5, 0, 1) * np.clip(tip * columns + 0.5, 0, 1)
    return cover


def grey_tint(tone: Array) -> Array:
    """Make a tint (A, C, 3) that changes only the lightness of a colour."""
    return np.repeat(tone[..., None], 3, 2)


def rows_for(length: float) -> int:
    """Return the number of sheet rows for a stroke of the given ``length`` in widths."""
    return int(np.clip(COLUMNS * (length + 2 * BEYOND_ENDS), 16, MOST_ROWS))


def draw_sheets(layout: StrokeLayout, draw: Callable[[float], Sheet]) -> StrokeWindows:
    """Draw each stroke from its own sheet, in a window of its own size with one texel per pixel.

    ``draw`` makes the sheet of a stroke, given its length in widths.
    """
    corner, side = place_windows(layout, layout.width * (0.5 + BEYOND_SIDES + BEYOND_ENDS) + MARGIN)
    points = points_on(layout.curve - corner[:, None], POINTS).astype(F)
    windows = []
    for k in range(len(layout)):
        width = max(float(layout.width[k]), 1e-3)
        steps = np.linalg.norm(np.diff(points[k], axis=0), axis=1)
        sheet = draw(float(steps.sum()) / width).reduce(width)
        texels = np.zeros((int(side[k]), int(side[k]), len(Texel)), F)
        _bend(points[k], F(width), layout.color[k].astype(F), sheet.cover, sheet.tint, sheet.height, texels)
        windows.append(close_gaps(texels, max(NARROWEST_GAP, round(GAP_SHARE * width))))
    return join_windows(windows, side, corner + 0.5 * side[:, None], layout)


@function
def _bend(points, width, color, cover, tint, height, texels):
    """Draw a sheet along ``points`` (P, 2) into empty texels (S, S, len(Texel)), leaving `CLOSED` unset."""
    side, rows, columns = len(texels), cover.shape[0], cover.shape[1]
    length = length_of_line(points)
    reach = (F(0.5) + F(BEYOND_SIDES)) * width
    ends = F(BEYOND_ENDS) * width
    for y in range(side):
        for x in range(side):
            _, along, across = nearest_place(points, x + F(0.5), y + F(0.5))
            if abs(across) > reach or along < -ends or along > length + ends:
                continue
            row = (along + ends) / (length + 2 * ends) * (rows - 1)
            column = (across + reach) / (2 * reach) * (columns - 1)
            top, left = min(int(row), rows - 2), min(int(column), columns - 2)
            down, right = row - top, column - left
            paint, high = F(0), F(0)
            red, green, blue = F(0), F(0), F(0)
            for i in range(2):
                for j in range(2):
                    share = (down if i else 1 - down) * (right if j else 1 - right)
                    here = share * cover[top + i, left + j]
                    paint += here
                    high += share * height[top + i, left + j]
                    red += here * tint[top + i, left + j, 0]
                    green += here * tint[top + i, left + j, 1]
                    blue += here * tint[top + i, left + j, 2]
            if paint <= 0:
                continue
            texels[y, x, 0] = paint * unit(color[0] * red / paint)
            texels[y, x, 1] = paint * unit(color[1] * green / paint)
            texels[y, x, 2] = paint * unit(color[2] * blue / paint)
            texels[y, x, Texel.ALPHA] = paint
            texels[y, x, Texel.HEIGHT] = high
