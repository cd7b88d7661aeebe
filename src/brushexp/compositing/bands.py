"""Paint a picture in bands of rows, so that a huge picture needs little more memory than its pixels do."""

from collections.abc import Iterator
from typing import Protocol

import torch
from torch import Tensor

from brushexp.compositing.layers import Compose, Layers, Size
from brushexp.strokes.catalogue import Strokes

BAND = 2**20  # pixels of a band
LEAST_ROWS = 64  # rows below which a band is not halved to save memory for layers


class Drawer(Protocol):
    """A callable that draws strokes as layers, like a `Renderer`."""

    @property
    def at_once(self) -> int | None:
        """Largest number of strokes whose layers are held in memory at once; None for no limit."""

    def __call__(self, strokes: Strokes) -> Layers:
        """Return N strokes as layers."""

    def rows(self, strokes: Strokes) -> Tensor | None:
        """Return the first and last pixel row (N, 2) that each stroke may touch; None if they are unknown."""


@torch.no_grad()
def bands(
    strokes: Strokes, front_to_back: Tensor, size: Size, background: Tensor, renderer: Drawer, blend: Compose
) -> Iterator[tuple[int, Tensor]]:
    """Paint strokes band by band, from the top of the canvas to the bottom; the arguments are those of `Blend`.

    Yields the first row and the picture (3, h, W) of each band. Only the strokes that may touch a band are drawn for
    it.
    """
    place = front_to_back.argsort()
    for top, rows, number in cuts(strokes, size, renderer):
        yield top, band_of(strokes, place, number, (top, rows, size[1]), background, renderer, blend)


@torch.no_grad()
def band_of(
    strokes: Strokes, place: Tensor, number: Tensor, band: tuple[int, int, int], background: Tensor,
    renderer: Drawer, blend: Compose,
) -> Tensor:  # fmt: skip
    """Paint the strokes with indices ``number`` (n,) in a band; ``place`` (N,) ranks all strokes, 0 for the top one."""
    top, *size = band
    layers = renderer(strokes[number].moved(shift=(0, -top)))
    return blend(layers, place[number].argsort(), (size[0], size[1]), background).image


@torch.no_grad()
def cuts(strokes: Strokes, size: Size, renderer: Drawer) -> Iterator[tuple[int, int, Tensor]]:
    """Divide a canvas of ``size`` (H, W) into bands; yield the first row, height and stroke indices of each."""
    height, width = size
    rows = renderer.rows(strokes)
    top, number = 0, torch.arange(len(strokes), device=strokes.position.device)
    while top < height:
        band = min(max(1, BAND // width), height - top)
        if rows is not None:
            number = within(rows, top, band)
            while band > LEAST_ROWS and len(number) > (renderer.at_once or len(number)):
                band = band // 2
                number = within(rows, top, band)
        yield top, band, number
        top += band


def within(rows: Tensor, top: int, height: int) -> Tensor:
    """Find the strokes whose row ranges (N, 2) overlap the ``height`` rows that start at ``top``."""
    return ((rows[:, 1] > top) & (rows[:, 0] < top + height)).nonzero()[:, 0]
