"""Round strokes to integers, and convert the integers back to strokes."""

from dataclasses import dataclass, replace
from enum import IntEnum

import numpy as np
import torch
from torch import Tensor

from brushexp.contracts.strokes import (
    FARTHEST_POSITION,
    FIELDS,
    Strokes,
    curve_of,
    drift_of,
    half_width_of,
    softness_of,
    strokes_along,
)
from brushexp_coding.entropy import LARGEST

FINE = 64  # index of the step 1 on the ladder of steps
RUNGS = (1.0, 1.1875, 1.4140625, 1.6796875)  # four steps per octave, exact in double precision
LADDER = np.array([RUNGS[(rung - FINE) % 4] * 2.0 ** ((rung - FINE) // 4) for rung in range(256)])  # all possible steps
ROOM = 2.0  # margin in pixels of a window around the stroke
MAX_COARSENESS = 8  # maximum magnitude of a stroke's coarseness, in octaves


class Column(IntEnum):
    """Columns of numbers that describe strokes; all lengths are in pixels.

    OFFSET_X to SIDE are only stored for renderers that draw in windows.
    """

    THICKNESS = 0
    CHORD_X = 1  # vector from start to end
    CHORD_Y = 2
    BEND_X = 3  # vector from the middle of the chord to the control point
    BEND_Y = 4
    SOFTNESS = 5
    MIDDLE_X = 6  # centre of the curve
    MIDDLE_Y = 7
    OPACITY = 8
    RED = 9
    GREEN = 10
    BLUE = 11
    WIDENING = 12
    DRIFT_RED = 13
    DRIFT_GREEN = 14
    DRIFT_BLUE = 15
    OFFSET_X = 16  # vector from the centre of the curve to the centre of the window
    OFFSET_Y = 17
    SIDE = 18  # side of the window


DRIFT = tuple(range(Column.DRIFT_RED, Column.DRIFT_BLUE + 1))
PAINT = (Column.RED, Column.GREEN, Column.BLUE, *DRIFT)
WINDOW_COLUMNS = (Column.OFFSET_X, Column.OFFSET_Y, Column.SIDE)
REVERSED = (Column.CHORD_X, Column.CHORD_Y, Column.WIDENING, *DRIFT)


@dataclass(frozen=True)
class Rounded:
    """N strokes as integers, bottom to top; each value is an integer times its column's step times 2**coarseness.

    A stroke has separate coarseness values, in octaves, for its shape and its paint: errors in its shape matter in
    proportion to its contrast with the surroundings, and errors in its colour in proportion to its visible area.
    """

    numbers: np.ndarray  # (N, C) int64, where C is the number of columns
    coarseness: np.ndarray  # (N, 2) int64, one octave for the shape and one for the paint
    rungs: np.ndarray  # (C,) int64 indices of the columns' steps on the `LADDER`
    windows: bool  # whether windows are stored; otherwise they fit closely around the curves
    brushes: np.ndarray | None = None  # (N,) int64; None if the renderer ignores brushes

    @classmethod
    def none(cls) -> "Rounded":
        """Make an empty set of strokes."""
        columns = len(Column) - len(WINDOW_COLUMNS)
        return cls(np.zeros((0, columns), np.int64), np.zeros((0, 2), np.int64), np.zeros(columns, np.int64), False)

    def __len__(self) -> int:
        return len(self.numbers)

    @property
    def steps(self) -> np.ndarray:
        """Step size (N, C) of each number, float64."""
        return np.ldexp(LADDER[self.rungs][None], self.octaves.astype(np.int32))

    @property
    def middles(self) -> np.ndarray:
        """Centres (N, 2) of the curves in pixels, float64."""
        place = slice(Column.MIDDLE_X, Column.MIDDLE_Y + 1)
        return self.numbers[:, place] * self.steps[:, place]

    @property
    def octaves(self) -> np.ndarray:
        """Coarseness (N, C) of each number, in octaves."""
        return self.coarseness[:, is_paint(self.numbers.shape[1]).astype(int)]

    def strokes(self) -> Strokes:
        """Convert the numbers back to strokes."""
        strokes = strokes_of(torch.from_numpy(self.numbers * self.steps), windows=self.windows)
        strokes = strokes.map(lambda value: value.float())
        return strokes if self.brushes is None else replace(strokes, brush=torch.from_numpy(self.brushes))


def is_paint(columns: int) -> np.ndarray:
    """Mark the columns that describe paint, among the first ``columns`` columns."""
    return np.isin(np.arange(columns), PAINT)


def rung_near(step: float) -> int:
    """Return the index of the largest step on the `LADDER` that is at most ``step``."""
    return max(0, int(np.searchsorted(LADDER, step * (1 + 1e-9), side="right")) - 1)


def values_of(strokes: Strokes, *, windows: bool) -> Tensor:
    """Compute the values (N, C) of the columns that describe strokes, in double precision."""
    strokes = strokes.map(lambda value: value.detach().cpu().double())
    start, control, end = curve_of(strokes).unbind(1)
    middle = (start + 2 * control + end) / 4
    paint = [strokes.opacity[:, None], strokes.color, strokes.widening[:, None], drift_of(strokes)]
    shape = [2 * half_width_of(strokes)[:, None], end - start, control - (start + end) / 2]
    values = [*shape, softness_of(strokes)[:, None], middle, *paint]
    values += [strokes.position - middle, strokes.scale[:, None]] if windows else []
    return torch.cat(values, dim=1)


def strokes_of(values: Tensor, *, windows: bool) -> Strokes:
    """Make strokes from the values (N, C) of the columns, differentiably; values out of range are clamped."""
    column = values.unbind(1)
    middle, chord, bend = (values[:, at : at + 2] for at in (Column.MIDDLE_X, Column.CHORD_X, Column.BEND_X))
    control = middle + bend / 2
    start, end = middle - bend / 2 - chord / 2, middle - bend / 2 + chord / 2
    thickness, softness = column[Column.THICKNESS].clamp(min=0), column[Column.SOFTNESS].clamp(min=0)
    curve = torch.stack([start, control, end], dim=1)
    low, high = curve.amin(1), curve.amax(1)
    if windows:
        position = middle + values[:, Column.OFFSET_X : Column.OFFSET_Y + 1]
        side = column[Column.SIDE]
    else:
        position = (low + high) / 2
        side = (high - low).amax(1) + thickness + ROOM
    position = position.clamp(-FARTHEST_POSITION, FARTHEST_POSITION)
    side = side.maximum(softness / FIELDS["softness"].high).clamp(FIELDS["scale"].low, FARTHEST_POSITION)
    strokes = strokes_along(
        curve - position[:, None],
        thickness,
        values[:, Column.RED : Column.BLUE + 1],
        column[Column.OPACITY].clamp(0, 1),
        window=side,
        position=position,
    )
    rest = {"softness": softness / side, "widening": column[Column.WIDENING].clamp(-1, 1)}
    drift = values[:, Column.DRIFT_RED : Column.DRIFT_BLUE + 1].clamp(-0.5, 0.5)
    strokes = replace(strokes, **rest, drift=drift)
    bounded = {
        name: getattr(strokes, name).clamp(FIELDS[name].low, FIELDS[name].high)
        for name in ("start", "control", "end", "width", "softness")
    }
    return replace(strokes, **bounded)


def round_values(values: Tensor, steps: np.ndarray) -> np.ndarray:
    """Round values (N, C) to integer multiples of their steps (N, C)."""
    numbers = np.rint(values.detach().numpy() / steps)
    return np.clip(numbers, 1 - LARGEST // 2, LARGEST // 2 - 1).astype(np.int64)


def orient_right(values: Tensor) -> Tensor:
    """Reverse strokes (N, C) that point left; this only changes the picture if the renderer has textures."""
    back = (values[:, Column.CHORD_X] < 0) | ((values[:, Column.CHORD_X] == 0) & (values[:, Column.CHORD_Y] < 0))
    signs = torch.ones_like(values)
    signs[:, list(REVERSED)] = torch.where(back, -1.0, 1.0).to(values)[:, None]
    return values * signs
