"""One canvas of `TexturedProfile` layers as the compiled kernels see it: numpy in, numpy out."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from brushexp.compositing import textured_kernels
from brushexp.compositing.nearest import AREA
from brushexp.compositing.profile_scene import NO_TARGET, sums_by_stroke
from brushexp.compositing.tile_lists import Array, TileLists

F = np.float32


@dataclass
class TexturedScene:
    """Textures, settings and lists of one pass; `paint` leaves behind what `gradient` needs.

    Attributes:
        lists: tile lists of the strokes in ``order``.
        size: (H, W).
        background: (3,).
        opaque: fraction of light below which a tile is finished.
        order: (N,) indices of the strokes, the uppermost first.
        look: (N,) number of each stroke's texture.
        cells: (M, rows + 1, columns + 1, 2) int32 textures, see `renderer.base.TexturedProfile`.
        used: (tiles,) how much of each list was looked at; set by `paint`.
        there: (pairs,) whether a stroke is anywhere in its tile, for `gradient`; set by `paint`.
        nearest: (pairs, 64) nearest parameters, for `gradient`; set by `paint`.
        errors: (N, 2) sums of alpha |color - target|^2 and of alpha; set by `paint` if it is given a target.
    """

    lists: TileLists
    size: tuple[int, int]
    background: Array
    opaque: float
    order: Array
    look: Array
    cells: Array
    used: Array = field(init=False)
    there: Array = field(init=False)
    nearest: Array = field(init=False)
    errors: Array = field(init=False)

    def paint(self, strokes: Array, target: Array | None, *, keep: bool) -> Array:
        """Picture (3, H, W) of strokes (N, 12), see `textured_kernels.COLUMNS`; ``keep`` if `gradient` will follow."""
        pairs = len(self.lists.stroke)
        self.used = np.zeros(len(self.lists.first) - 1, np.int64)
        self.there = np.zeros(pairs, np.bool_)
        self.nearest = np.empty((pairs if keep else 0, AREA), np.uint16)
        image = np.empty((3, *self.size), F)
        errors = np.zeros((0 if target is None else pairs, 2), F)
        goal = NO_TARGET if target is None else target
        textured_kernels.forward(
            strokes[self.order], *self._given(), self.background, F(self.opaque), goal, image, self.used, self.there,
            self.nearest, errors,
        )  # fmt: skip
        if target is not None:
            self.errors = sums_by_stroke(self.lists, self.order, errors)
        return image

    def gradient(self, strokes: Array, grad_image: Array) -> Array:
        """Gradient (N, 12) from the gradient (3, H, W) of the picture."""
        pairs = np.empty((len(self.lists.stroke), textured_kernels.COLUMNS), F)
        textured_kernels.backward(
            strokes[self.order], *self._given(), self.background, self.used, self.there, self.nearest, grad_image, pairs
        )
        return sums_by_stroke(self.lists, self.order, pairs)

    def _given(self) -> tuple[Any, Any, int]:
        """What both kernels take besides the strokes: textures, lists, tiles per row."""
        _, rows, columns, _ = self.cells.shape
        first = self.look[self.order] * (rows * columns)
        brush = (first, self.cells.reshape(-1).view(np.int64), (rows - 1, columns - 1))
        return brush, (self.lists.first, self.lists.stroke, self.lists.slot), self.lists.shape[1]
