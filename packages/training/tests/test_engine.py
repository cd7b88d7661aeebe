"""The plain brush simulator agrees with obvious loops; the contract of all of them is checked by test_plugins.py."""

import numpy as np
import torch
from torch.testing import assert_close

from brushexp.registry import build_named
from brushexp.strokes.prior import parameters_of, sample_prior, strokes_of

WINDOW = 32


def test_discs_agree_with_the_loop():
    parameters, side = parameters_of(sample_prior(3, seed=4)), 2 * WINDOW
    y, x = np.mgrid[:side, :side] + 0.5
    drawn = build_named("engine", "disc", {"window": WINDOW})(parameters, seed=1).images[:, 3]
    strokes = strokes_of(parameters.double())
    fields = (getattr(strokes, name).numpy() for name in ("start", "control", "end", "width"))
    for alpha, start, control, end, width in zip(drawn, *fields, strict=True):
        canvas = np.zeros((side, side))
        for t in np.arange(100) / 100:
            u, v = ((1 - t) ** 2 * start + 2 * t * (1 - t) * control + t**2 * end + 1) * side / 2
            canvas[np.hypot(x - u, y - v) <= width * side / 2] = 1
        assert_close(alpha, torch.from_numpy(canvas.reshape(WINDOW, 2, WINDOW, 2).mean((1, 3))).float())
