"""One canvas as the compiled kernels see it: numpy in, numpy out."""

from dataclasses import dataclass, field

import numpy as np

from brushexp.compositing import profile_kernels
from brushexp.compositing.nearest import AREA
from brushexp.compositing.tile_lists import Array, TileLists

F = np.float32
NO_TARGET = np.zeros((3, 0, 0), F)


@dataclass
class Scene:
    """Settings and lists of one pass; `paint` leaves behind what `gradient` needs.

    Attributes:
        lists: tile lists of the strokes in ``order``.
        size: (H, W).
        background: (3,).
        soft: width of the edge, pixels.
        taper: 0 to 1.
        opaque: fraction of light below which a tile is finished.
        order: (N,) indices of the strokes, the uppermost first.
        used: (tiles,) how much of each list was looked at; set by `paint`.
        nearest: (pairs, 64) nearest parameters, for `gradient`; set by `paint`.
        errors: (N, 2) sums of alpha |color - target|^2 and of alpha; set by `paint` if it is given a target.
    """

    lists: TileLists
    size: tuple[int, int]
    background: Array
    soft: float
    taper: float
    opaque: float
    order: Array
    used: Array = field(init=False)
    nearest: Array = field(init=False)
    errors: Array = field(init=False)

    def paint(self, strokes: Array, target: Array | None, *, keep: bool) -> Array:
        """Picture (3, H, W) of strokes (N, 11), see `profile_kernels.COLUMNS`; ``keep`` if `gradient` will follow."""
        lists = self.lists
        self.used = np.zeros(len(lists.first) - 1, np.int64)
        self.nearest = np.empty((len(lists.stroke) if keep else 0, AREA), np.uint16)
        image = np.empty((3, *self.size), F)
        pairs = np.zeros((0 if target is None else len(lists.stroke), 2), F)
        goal = NO_TARGET if target is None else target
        profile_kernels.forward(
            strokes[self.order], lists.first, lists.stroke, lists.slot, lists.shape[1], self.background, F(self.soft),
            F(self.taper), F(self.opaque), goal, image, self.used, self.nearest, pairs,
        )  # fmt: skip
        if target is not None:
            self.errors = sums_by_stroke(lists, self.order, pairs)
        return image

    def gradient(self, strokes: Array, grad_image: Array) -> Array:
        """Gradient (N, 11) from the gradient (3, H, W) of the picture."""
        lists = self.lists
        pairs = np.empty((len(lists.stroke), profile_kernels.COLUMNS), F)
        profile_kernels.backward(
            strokes[self.order], lists.first, lists.stroke, lists.slot, lists.shape[1], self.background, F(self.soft),
            F(self.taper), self.used, self.nearest, grad_image, pairs,
        )  # fmt: skip
        return sums_by_stroke(lists, self.order, pairs)

    def worth(self, strokes: Array, target: Array, weight: Array) -> Array:
        """By how much the squared error, weighted by (H, W), would grow without each stroke: (N,)."""
        error = self.paint(strokes, None, keep=True) - target
        lists = self.lists
        pairs = np.empty((len(lists.stroke), 1), F)
        profile_kernels.worth(
            strokes[self.order], lists.first, lists.stroke, lists.slot, lists.shape[1], self.background, F(self.soft),
            F(self.taper), self.used, self.nearest, error, weight, pairs,
        )  # fmt: skip
        return sums_by_stroke(lists, self.order, pairs)[:, 0]


def sums_by_stroke(lists: TileLists, order: Array, pairs: Array) -> Array:
    """Sums (N, C) over the pairs (pairs, C) of each stroke, in the order of the strokes themselves."""
    sums = np.empty((len(order), pairs.shape[1]), F)
    profile_kernels.sum_by_stroke(pairs, lists.row, sums)
    result = np.empty_like(sums)
    result[order] = sums
    return result
