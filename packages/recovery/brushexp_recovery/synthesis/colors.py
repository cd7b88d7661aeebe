"""Pick the colours of strokes from the picture that they paint."""

import warnings
from typing import Any

import numpy as np
from numpy.typing import NDArray

from brushexp_recovery.raster.blur import gaussian_blur
from brushexp_recovery.synthesis.hand import Hand, Random

Array = NDArray[Any]

BLURS = np.array([0.5, 1, 2, 4, 8, 16])  # blurs in pixels of the pictures from which colours are picked
BLUR_OF_WIDTH = 0.35  # blur in widths of a stroke
COLOR_SPREAD = (5.0, 3.5, 3.5)  # standard deviation in CIELAB between strokes of one paint
DARKEST, BRIGHTEST = 0.01, 0.99  # sRGB


def pick_colors(picture: Array, places: Array, width: Array, hand: Hand, random: Random) -> Array:
    """Pick colours (n, 3) from a picture blurred according to the strokes' widths, with small random variations."""
    from skimage.color import lab2rgb, rgb2lab  # noqa: PLC0415

    levels = np.stack([rgb2lab(gaussian_blur(picture, (sigma, sigma, 0))) for sigma in BLURS])
    level = np.abs(np.log(BLURS)[None] - np.log(BLUR_OF_WIDTH * width)[:, None]).argmin(1)
    x, y = places.astype(int).T
    color = levels[level, y, x]
    if hand.palette:
        paints = color[random.integers(0, len(color), hand.palette)]
        color = paints[((color[:, None] - paints[None]) ** 2).sum(-1).argmin(1)]
    color = color + random.normal(size=color.shape) * COLOR_SPREAD * np.array(hand.color)
    with warnings.catch_warnings(action="ignore"):  # warns about colours outside sRGB
        return np.clip(lab2rgb(color[None])[0], DARKEST, BRIGHTEST)
