"""Propose strokes of various sizes and estimate the gain of each."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from torch import Tensor

from brushexp.pictures.structure import along_edges, structure_tensor, worst_of_cells
from brushexp.plugins.density.base import DensificationState
from brushexp.strokes.bezier import strokes_along
from brushexp.strokes.catalogue import Strokes

SIDE_RATIO = 1.5  # ratio of the sides of successive patch sizes
SMALLEST_SIDE = 2.0  # pixels of a patch
LARGEST_SHARE = 0.5  # side of the largest patch, as a fraction of the picture's shorter side
ASPECTS = ((1.0, 1.0), (3.0, 1.0), (1.0, 3.0))  # width and height of patches, relative to their side
SQUARE = 1.5  # aspect ratio below which a patch counts as square
ELONGATION = 1.3  # length of the stroke of a square patch, relative to its side, along the edges of the picture
STRUCTURE = 1.5  # pixels over which the direction of edges is measured
STRIDE = 1 / 6  # distance between the places at which a patch is tried, relative to its side
OPACITY = 0.95
NOISE = 1e-6  # largest gain due to rounding errors
CANDIDATES = 200  # number of candidates of each size, in addition to the wanted number
OVERLAP = 0.3  # largest share of a patch that may overlap better patches
ROOM = 2.0  # window of a new stroke, relative to its length
SMALLEST_WINDOW = 16.0  # smallest window of a new stroke, pixels

Array = np.ndarray


@dataclass(frozen=True)
class Patches:
    """M rectangles of uniform colour, each with its gain, which is the decrease in squared error."""

    top: Array  # (M,) first row; all in pixels
    bottom: Array  # (M,) first row below the patch
    left: Array  # (M,) first column
    right: Array  # (M,) first column to the right of the patch
    gain: Array  # (M,)

    def __getitem__(self, chosen: Array) -> "Patches":
        return Patches(*(getattr(self, each.name)[chosen] for each in fields(self)))

    @staticmethod
    def join(parts: Sequence["Patches"]) -> "Patches":
        """Concatenate patches."""
        return Patches(*(np.concatenate([getattr(part, each.name) for part in parts]) for each in fields(Patches)))


def proposals(state: DensificationState, most: int, least: float) -> tuple[Strokes, Tensor]:
    """Propose at most ``most`` strokes, each with a gain above ``least``, best first; also return their gains (M,).

    The gain is the decrease in squared error (summed over pixels and channels, and weighted by the focus) if a
    rectangle of the stroke's size is painted in the target's mean colour.
    """
    like = state.strokes.position
    if most < 1:
        return Strokes.none(like), like.new_zeros(0)
    target = state.target.cpu().numpy().astype(np.float64)
    weight = np.ones(target.shape[1:]) if state.focus is None else state.focus.cpu().numpy().astype(np.float64)
    error = np.square(target - state.image.cpu().numpy()).sum(0)
    found = patches_of(target, error, weight, most, least)
    chosen = found[_apart(found, most, target.shape[1:])]
    return _strokes(chosen, target, like), like.new_tensor(chosen.gain)


def patches_of(target: Array, error: Array, weight: Array, most: int, least: float) -> Patches:
    """Find the best patches of each size with gains above ``least``, at most one in each cell of a lattice.

    A patch of the target's mean colour replaces the error (H, W), which is a sum over channels, with the variance of
    the target (C, H, W); both are weighted by ``weight`` (H, W). The gain therefore follows from sums over rectangles,
    which are read from a summed-area table (Crow, 1984). Patches of each size are tried at the points of a lattice with
    a spacing of `STRIDE` times their side.
    """
    size = target.shape[1:]
    maps = np.concatenate([(error - np.square(target).sum(0))[None], target, np.ones_like(target[:1])]) * weight
    table = np.pad(maps, ((0, 0), (1, 0), (1, 0))).cumsum(1).cumsum(2)
    found: list[Patches] = []
    side, largest = SMALLEST_SIDE, max(SMALLEST_SIDE, LARGEST_SHARE * min(size))
    while side <= largest:
        stride = max(1, round(STRIDE * side))
        for across, down in ASPECTS:
            height, width = (min(round(side * part), extent) for part, extent in zip((down, across), size, strict=True))
            (top, bottom), (left, right) = _spans(height, size[0], stride), _spans(width, size[1], stride)
            rows = table.take(bottom, 1) - table.take(top, 1)
            sums = rows.take(right, 2) - rows.take(left, 2)
            color = sums[1:-1]
            gain = sums[0] + np.einsum("chw,chw->hw", color, color) / sums[-1].clip(1e-9)
            _, column, row = worst_of_cells(gain, max(1, round(side / stride)))
            pays = gain[row, column] > max(least, NOISE)
            row, column = row[pays], column[pays]
            best = np.argsort(-gain[row, column], kind="stable")[: CANDIDATES + most]
            row, column = row[best], column[best]
            found.append(Patches(top[row], bottom[row], left[column], right[column], gain[row, column]))
        side *= SIDE_RATIO
    return Patches.join(found)


def _spans(length: int, extent: int, stride: int) -> tuple[Array, Array]:
    """Compute the starts and ends of spans, ``length`` pixels long and ``stride`` apart, cropped to ``extent``."""
    first = np.arange(0, extent, stride) - length // 2
    return first.clip(0), (first + length).clip(max=extent)


def _apart(patches: Patches, most: int, size: tuple[int, ...]) -> Array:
    """Select at most ``most`` patches with the largest gains and little overlap."""
    taken = np.zeros(size, bool)
    chosen: list[int] = []
    for number in np.argsort(-patches.gain, kind="stable").tolist():
        if len(chosen) == most:
            break
        there = taken[patches.top[number] : patches.bottom[number], patches.left[number] : patches.right[number]]
        if there.mean() <= OVERLAP:
            there[:] = True
            chosen.append(number)
    return np.array(chosen, int)


def _strokes(patches: Patches, target: Array, like: Tensor) -> Strokes:
    """Convert patches to strokes; strokes for square patches follow the edges in the target."""
    height, width = patches.bottom - patches.top, patches.right - patches.left
    long, thick = np.maximum(height, width), np.minimum(height, width)
    row, column = (patches.bottom + patches.top) // 2, (patches.right + patches.left) // 2
    edge = along_edges(structure_tensor(target, STRUCTURE)[:, row, column])
    is_square = long < SQUARE * thick
    angle = np.where(is_square, edge, np.where(height > width, math.pi / 2, 0.0))
    reach = np.where(is_square, (ELONGATION - 0.5) * long, long - thick / 2) / 2
    end = np.stack([np.cos(angle), np.sin(angle)], 1) * reach[:, None]
    curve = like.new_tensor(np.stack([-end, np.zeros_like(end), end], 1))
    window = like.new_tensor(np.maximum(SMALLEST_WINDOW, ROOM * long))
    place = like.new_tensor(np.stack([patches.right + patches.left, patches.bottom + patches.top], 1)) / 2
    color = like.new_tensor(_mean_colors(patches, target))
    return strokes_along(curve, like.new_tensor(thick), color, OPACITY, window=window, position=place)


def _mean_colors(patches: Patches, target: Array) -> Array:
    """Compute the mean colour (M, C) of a target (C, H, W) in each patch."""
    sums = np.pad(target, ((0, 0), (1, 0), (1, 0))).cumsum(1).cumsum(2)
    top, bottom, left, right = patches.top, patches.bottom, patches.left, patches.right
    total = sums[:, bottom, right] - sums[:, top, right] - sums[:, bottom, left] + sums[:, top, left]
    means: Array = (total / ((bottom - top) * (right - left))).T
    return means
