"""Where a painting needs strokes, and what they should be."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from brushexp.pictures.structure import along_edges, structure_tensor
from brushexp.plugins.density.base import DensificationState
from brushexp.strokes.bezier import curve_of, half_width_of, length_of, point_at
from brushexp.strokes.catalogue import Strokes

BLUR = 0.45  # of the error, in sizes of a new stroke
SPACING = 2.5  # sizes of a new stroke between two of them at least, roughly
LENGTH, THICKNESS = 1.4, 0.8  # of a new stroke, in its size: as the initialisers lay them
OPACITY = 0.95
STRUCTURE = 1.5  # pixels over which the picture's direction is read

Array = np.ndarray


@dataclass(frozen=True)
class Candidates:
    """Pixels where strokes are missing, the worst first.

    Attributes:
        row: (K,) of the picture.
        column: (K,)
        size: of a stroke there, pixels.
    """

    row: Array
    column: Array
    size: float

    def __len__(self) -> int:
        return len(self.row)

    def __getitem__(self, index: slice) -> Candidates:
        return Candidates(self.row[index], self.column[index], self.size)

    def strokes(self, state: DensificationState) -> Strokes:
        """A stroke at each place: in the target's colour, along its edges."""
        target, like = state.target.cpu().numpy(), state.strokes.position
        tensor = structure_tensor(target, STRUCTURE)[:, self.row, self.column]
        angle = like.new_tensor(along_edges(tensor))
        windows = state.strokes.scale if len(state.strokes) else like.new_ones(1)
        scale = windows.median().clamp_min(LENGTH * self.size).expand(len(self))
        end = torch.stack([angle.cos(), angle.sin()], dim=1) * (LENGTH * self.size / scale)[:, None]
        return Strokes(
            position=like.new_tensor(np.stack([self.column, self.row], 1)) + 0.5,
            scale=scale.clone(),
            start=-end,
            control=torch.zeros_like(end),
            end=end,
            width=THICKNESS * self.size / scale,
            color=like.new_tensor(target[:, self.row, self.column].T).clamp(0, 1),
            opacity=torch.full_like(scale, OPACITY),
        )


def candidates(state: DensificationState, n: int, size: float, tolerance: float) -> Candidates:
    """The ``n`` worst places, or fewer: one in each cell of a lattice, where its error is largest.

    Args:
        state: the painting.
        n: places that are wanted.
        size: of a new stroke, in pitches (mean distances between strokes).
        tolerance: root mean square of the error over a stroke below which a place is good enough.
    """
    from scipy.ndimage import gaussian_filter  # noqa: PLC0415  (--help does not need it)

    height, width = state.target.shape[1:]
    pixels = size * math.sqrt(height * width / max(state.budget, 1))
    error = (state.image - state.target).square().mean(0)
    if state.focus is not None:
        error = error * state.focus
    blurred = gaussian_filter(error.cpu().numpy(), BLUR * pixels)
    cell = max(2, round(SPACING * pixels))
    row, column, worst = _worst_of_cells(blurred, cell)
    order = np.argsort(-worst, kind="stable")
    order = order[: min(n, int((worst > tolerance**2).sum()))]
    return Candidates(row[order], column[order], pixels)


def _worst_of_cells(error: Array, cell: int) -> tuple[Array, Array, Array]:
    """Row, column and error of the worst pixel in each square of ``cell`` pixels."""
    height, width = error.shape
    rows, columns = -(-height // cell), -(-width // cell)
    padded = np.full((rows * cell, columns * cell), -1.0, error.dtype)
    padded[:height, :width] = error
    cells = padded.reshape(rows, cell, columns, cell).transpose(0, 2, 1, 3).reshape(rows * columns, -1)
    at = cells.argmax(1)
    number = np.arange(rows * columns)
    return number // columns * cell + at // cell, number % columns * cell + at % cell, cells.max(1)


def straddling(state: DensificationState) -> Tensor:
    """How much squared error each of N strokes hides at least because an edge crosses it (N,).

    The target's colours under its two halves, read at two points each, differ by d: one colour for both leaves
    area * |d|^2 / 4 where the stroke is all that is seen.
    """
    strokes, target = state.strokes, state.target
    curve = curve_of(strokes)
    t = curve.new_tensor([0.1, 0.35, 0.65, 0.9])
    points = point_at(curve[:, None], t.expand(len(curve), -1)).floor().long()
    column, row = points[..., 0].clamp(0, target.shape[2] - 1), points[..., 1].clamp(0, target.shape[1] - 1)
    colors = target[:, row, column]  # (3, N, 4)
    difference = colors[..., :2].mean(-1) - colors[..., 2:].mean(-1)
    area = length_of(curve) * 2 * half_width_of(strokes)
    return area * difference.square().sum(0) / 4


def halves(strokes: Strokes) -> Strokes:
    """Each of N strokes cut in two in the middle (de Casteljau): the first halves, then the second ones, (2N)."""
    start, control, end = strokes.start, strokes.control, strokes.end
    before, after = (start + control) / 2, (control + end) / 2
    middle = (before + after) / 2
    return Strokes.join(_with_points(strokes, start, before, middle), _with_points(strokes, middle, after, end))


def _with_points(strokes: Strokes, start: Tensor, control: Tensor, end: Tensor) -> Strokes:
    """Strokes through other points, given in half-windows from their position, which moves between their ends."""
    centre = (start + end) / 2
    position = strokes.position + centre * (strokes.scale / 2)[:, None]
    return replace(strokes, position=position, start=start - centre, control=control - centre, end=end - centre)
