"""Which part of a picture a feature sees, so that features of parts are those of the whole."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from copy import deepcopy
from dataclasses import dataclass
from weakref import WeakKeyDictionary

import torch
from torch import Tensor

from brushexp.features.base import Backbone
from brushexp.pictures.region import Region

ROUNDING = 1e-12  # activations that differ by less are the same
TILE = 512  # pixels: pictures are looked at in tiles of this side, each with what its features see around it


@dataclass(frozen=True)
class Sight:
    """What activations of a network see, on either axis: number i pixels i * stride - before to i * stride + after.

    Attributes:
        before: pixels, the most of all taps.
        after: pixels, the most of all taps.
        field: pixels that one activation of the farthest tap sees on an axis.
        strides: of each tap, pixels.
        least: shorter sides are widened to so many pixels before the network looks, which moves its activations.
    """

    before: int
    after: int
    field: int
    strides: tuple[int, ...]
    least: int = 1

    @property
    def grid(self) -> int:
        """Parts of a picture that begin at multiples of it have their activations where the whole has them."""
        return max(self.strides)

    @property
    def margin(self) -> int:
        """Pixels around a region on which the activations that see the region may depend.

        A part with so many around it, as far as there is a picture, is only widened where the whole picture is.
        """
        return max(self.before + self.after, self.least)

    def touched(self, region: Region, size: tuple[int, int]) -> Region:
        """The zone of the activations that see something of a region, from one multiple of the grid to another."""
        (top, bottom), (left, right) = (
            (max(first - self.after, 0) // self.grid * self.grid, min(_up(last + self.before, self.grid), side))
            for first, last, side in _spans(region, size)
        )
        return Region(top, left, bottom - top, right - left)

    def needed(self, zone: Region, size: tuple[int, int]) -> Region:
        """What the activations of a zone see, of a length that pads the picture as its whole ``size`` (H, W) does."""
        return aligned(zone, size, self.before, self.after, self.grid)

    def shares(self, found: Sequence[Tensor], part: tuple[int, int], size: tuple[int, int]) -> list[float]:
        """Of the positions of each tap in the whole picture, the share that a part has.

        Args:
            found: activations (..., h, w) of the part.
            part: its size in pixels (H, W), as `aligned` makes it.
            size: of the whole picture, pixels (H, W).
        """
        return [
            math.prod(
                n / (n + (whole - side) // stride) for n, side, whole in zip(value.shape[-2:], part, size, strict=True)
            )
            for value, stride in zip(found, self.strides, strict=True)
        ]


def aligned(region: Region, size: tuple[int, int], before: int, after: int, grid: int) -> Region:
    """A region with what lies so many pixels before and after it, on a grid, as far as there is a picture.

    It begins at multiples of ``grid``, and its sides leave the same remainder as those of the picture (H, W), ``size``:
    networks with steps of such a grid pad both alike, and have their activations in the same places.
    """
    (top, bottom), (left, right) = (
        (max(first - before, 0) // grid * grid, min(side % grid + _up(last + after - side % grid, grid), side))
        for first, last, side in _spans(region, size)
    )
    return Region(top, left, bottom - top, right - left)


_known: WeakKeyDictionary[Backbone, dict[tuple[str, ...], Sight]] = WeakKeyDictionary()


def sight_of(network: Backbone, taps: Sequence[str]) -> Sight:
    """What taps see; it is found out when first asked for, and kept for as long as there is the network."""
    found = _known.setdefault(network, {})
    if tuple(taps) not in found:
        found[tuple(taps)] = _look(network, taps)
    return found[tuple(taps)]


def _look(network: Backbone, taps: Sequence[str]) -> Sight:
    """Find out what taps see, from which activations change with one pixel of a row.

    With sides of a power of two, and of one more, the padding is the least and the most there can be.
    """
    network = deepcopy(network).cpu().double()  # what is no more than rounding can then be told from a change
    generator = torch.Generator().manual_seed(0)
    side = 64
    while True:
        side *= 2
        fewer, more = (_activations(network, torch.zeros(1, 3, 1, width), taps) for width in (side, 2 * side))
        strides = tuple(side // (b.shape[-1] - a.shape[-1]) for a, b in zip(fewer, more, strict=True))
        place = side // 2 + torch.arange(max(strides))
        reached = []
        for width in (side, side + 1):
            rows = torch.rand(1, 3, 1, width, generator=generator).repeat(1 + len(place), 1, 1, 1)
            rows[1 + torch.arange(len(place)), :, 0, place] += 1  # row 0 stays as it is
            found = _activations(network, rows, taps)
            seen = [(value[1:] - value[:1]).abs().amax(1)[:, 0] > ROUNDING for value in found]
            if any(bool(marks[:, [0, -1]].any()) for marks in seen):
                break  # it may see beyond the row: take a longer one
            reached.append([_reach(marks, place, stride) for marks, stride in zip(seen, strides, strict=True)])
        else:
            every = [reach for row in reached for reach in row]
            before, after = max(b for b, _ in every), max(a for _, a in every)
            return Sight(before, after, max(b + a + 1 for b, a in every), strides, network.least)


def activations_of(
    network: Backbone,
    taps: Sequence[str],
    sight: Sight,
    zone: Region,
    size: tuple[int, int],
    cut: Callable[[Region], Tensor],
) -> list[Tensor]:
    """Activations (C, positions) of each tap in a zone, the same as in the whole picture.

    Args:
        network: the network.
        taps: names of its activations.
        sight: what those see.
        zone: pixels i * stride of the activations; it begins at multiples of the grid and ends at
            one or with the picture.
        size: of the whole picture, pixels (H, W).
        cut: gives a part (3, h, w) of the picture.
    """
    part = sight.needed(zone, size)
    found = network(cut(part)[None], taps)
    values = []
    for tap, stride in zip(taps, sight.strides, strict=True):
        top, left = (zone.top - part.top) // stride, (zone.left - part.left) // stride
        bottom, right = top + -(-zone.height // stride), left + -(-zone.width // stride)
        values.append(found[tap][0, :, top:bottom, left:right].flatten(1))
    return values


def tiles(zone: Region) -> Iterator[Region]:
    """A zone in parts of bounded size."""
    for top in range(zone.top, zone.top + zone.height, TILE):
        for left in range(zone.left, zone.left + zone.width, TILE):
            height, width = zone.top + zone.height - top, zone.left + zone.width - left
            yield Region(top, left, min(TILE, height), min(TILE, width))


def _spans(region: Region, size: tuple[int, int]) -> Iterator[tuple[int, int, int]]:
    """First pixel, last pixel + 1 and side of the picture, for rows and for columns."""
    yield region.top, region.top + region.height, size[0]
    yield region.left, region.left + region.width, size[1]


def _up(value: int, step: int) -> int:
    """The least multiple of ``step`` that is not below ``value``."""
    return -(-value // step) * step


@torch.no_grad()
def _activations(network: Backbone, pictures: Tensor, taps: Sequence[str]) -> list[Tensor]:
    found = network(pictures, taps)
    return [found[tap] for tap in taps]


def _reach(marks: Tensor, place: Tensor, stride: int) -> tuple[int, int]:
    """How many pixels activations see before and after their own; marks (places, activations): which see a place."""
    number = torch.arange(marks.shape[1])
    first = torch.where(marks, number, marks.shape[1]).amin(1)
    last = torch.where(marks, number, -1).amax(1)
    return int((last * stride - place).max()), int((place - first * stride).max())
