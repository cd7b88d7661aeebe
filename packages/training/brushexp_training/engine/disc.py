"""Simulate the simplest brush, a row of discs; each worker paints one stroke at a time on its own canvas."""

from typing import Annotated

import numpy as np
import torch
from torch import Tensor

from brushexp.contracts import between, register
from brushexp.contracts.families import Engine, Simulated
from brushexp.contracts.kernels import function
from brushexp.contracts.machine import share
from brushexp.contracts.strokes import strokes_of

DISCS = 100  # disc number i lies at t = i / DISCS
SUPERSAMPLE = 2  # pixels of the canvas per pixel of the picture, in each direction
MIN_RADIUS = 1.0  # minimum radius of a disc in pixels of the canvas
FARTHEST_POINT, WIDEST_STROKE = 4.0, 4.0  # upper bounds of coordinates (half-windows) and widths (windows)

F = np.float32


@register("engine", "disc")
class Disc(Engine):
    """A smooth tube of 100 discs along a Bezier curve (Learning to Paint: Huang et al., 2019, arXiv:1903.04411).

    The discs are painted on a canvas of twice the resolution, which is then averaged. Alpha, which is also the height,
    is the covered fraction of a pixel. Nothing is random. As in the source, a curve much longer than the window breaks
    up into separate discs, and the last disc is at t = 0.99. Coordinates are clamped to 4 half-windows.

    Unlike in the source, thickness and colour are the same at both ends, the control point is absolute instead of
    relative to the end points, and discs are not rounded to whole pixels.

    Args:
        window: side of a picture in pixels, 8 to 512.
    """

    is_random = False

    def __init__(self, *, window: Annotated[int, between(8, 512)] = 64) -> None:
        self.window = window

    def __call__(self, parameters: Tensor, *, seed: int, first: int = 0) -> Simulated:
        strokes = strokes_of(parameters.detach().cpu().float())
        side = SUPERSAMPLE * self.window
        points = torch.cat([strokes.start, strokes.control, strokes.end], dim=1).double()
        curve = (points.clamp(-FARTHEST_POINT, FARTHEST_POINT) + 1) * (0.5 * side)
        radius = (0.5 * side * strokes.width.double().clamp(0, WIDEST_STROKE)).clamp_min(MIN_RADIUS)
        alpha = torch.empty(len(curve), self.window, self.window)
        share(_paint, len(curve), curve.numpy(), radius.numpy(), alpha.numpy())
        color = strokes.color.clamp(0, 1)[:, :, None, None].expand(-1, -1, *alpha.shape[1:])
        return Simulated(torch.cat([color, alpha[:, None]], dim=1), alpha)


@function
def _paint(begin, end, curve, radius, alpha):  # type: ignore[no-untyped-def]
    """Compute the fraction of each pixel that a stroke's discs cover, for the strokes ``begin`` to ``end``.

    The result is written to ``alpha`` (n, S, S). The points in ``curve`` (n, 6) and the ``radius`` (n,) are in pixels
    of the finer canvas.
    """
    side = alpha.shape[1] * SUPERSAMPLE
    for i in range(begin, end):
        bare = np.ones((side, side), F)
        for k in range(DISCS):
            t = k / DISCS
            a, b, c = (1 - t) * (1 - t), 2 * t * (1 - t), t * t
            x = a * curve[i, 0] + b * curve[i, 2] + c * curve[i, 4]
            y = a * curve[i, 1] + b * curve[i, 3] + c * curve[i, 5]
            _disc(bare, x, y, radius[i])
        for row in range(len(alpha[i])):
            for column in range(len(alpha[i])):
                top, left = SUPERSAMPLE * row, SUPERSAMPLE * column
                alpha[i, row, column] = F(1) - bare[top : top + SUPERSAMPLE, left : left + SUPERSAMPLE].mean()


@function
def _disc(bare, x, y, radius):  # type: ignore[no-untyped-def]
    top, bottom = _pixels(y, radius, len(bare))
    for row in range(top, bottom):
        dy = row + 0.5 - y
        left, right = _pixels(x, np.sqrt(max(radius * radius - dy * dy, 0.0)), len(bare))
        bare[row, left:right] = 0


@function
def _pixels(middle, reach, side):  # type: ignore[no-untyped-def]
    """Return the half-open range of pixels whose centres are within ``reach`` of ``middle``."""
    low, high = np.ceil(middle - reach - 0.5), np.floor(middle + reach - 0.5) + 1
    return int(min(max(low, 0), side)), int(min(max(high, 0), side))
