"""The plainest brush: a row of discs."""

from typing import Annotated

import numpy as np
from torch import Tensor

from brushexp.bounds import between
from brushexp.plugins.engine.base import Engine, Simulated
from brushexp.registry import register
from brushexp.strokes.prior import strokes_of
from brushexp.system.runtime import share_threads

DISCS = 100  # number i lies at t = i / DISCS
SUPERSAMPLE = 2  # pixels of the canvas per pixel of the picture, in each direction
MIN_RADIUS = 1.0  # of a disc, pixels of that canvas


@register("engine", "disc")
class Disc(Engine):
    """Bezier curve of 100 discs (Learning to Paint: Huang et al., 2019, arXiv:1903.04411): a smooth tube.

    The discs are painted on a canvas twice as fine and averaged. Alpha is the share of a pixel that they cover; it is
    also the height. Nothing is random. A curve much longer than the window falls apart into single discs, as in the
    source, whose last disc also lies at t = 0.99. Points farther than 4 half-windows from the centre are brought there.

    Differs from the source: one thickness and one colour instead of one at each end; the control point is a place of
    its own instead of one relative to the end points; discs are not rounded to whole pixels.

    Args:
        window: pixels on the side of a picture, 8 to 512.
    """

    is_random = False

    def __init__(self, *, window: Annotated[int, between(8, 512)] = 64) -> None:
        from brushexp.plugins.engine import _stamps  # noqa: PLC0415  (Numba takes a second; --help should not)

        self._stamps = _stamps
        self.window = window

    def __call__(self, parameters: Tensor, *, seed: int, first: int = 0) -> Simulated:
        share_threads()
        strokes = strokes_of(parameters.detach().cpu().float())
        curve, width = self._stamps.curves_of(strokes, SUPERSAMPLE * self.window)
        alpha = np.empty((len(curve), self.window, self.window), np.float32)
        self._stamps.discs(curve, np.maximum(0.5 * width, MIN_RADIUS), DISCS, SUPERSAMPLE, alpha)
        return self._stamps.one_colour(strokes, alpha)
