"""Ink the eyes and mouth of a face that is too small for drawn lines."""

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor, nn

from brushexp.contracts.families import Initializer
from brushexp.contracts.strokes import Strokes
from brushexp_media.init.ink import INKED, rgb_of, strokes_of
from brushexp_media.init.washes import fill_shape, remove_specks
from brushexp_media.picture.lines import edge_lines

SIDE = 96  # longer side in pixels at which dark shapes are found
THICK, FAINT = 20.0, 0.015  # scale of lines relative to a pen's, and least difference of a line
DARKER = 0.6  # standard deviations below the mean of the largest channel at which a pixel is inked
BROADEST = 0.12  # width of a stroke, in longer sides
SPECK = 0.002  # share of the target below which a shape is a speck


@dataclass(kw_only=True)
class DarkShapes(Initializer):
    """Ink strokes that fill areas darker than their surroundings, such as lids, pupils, brows and the line of a mouth.

    Args:
        color: colour of the ink, as '#rrggbb'.
    """

    color: str

    def __call__(self, target: Tensor, n: int, generator: torch.Generator, focus: Tensor | None = None) -> Strokes:
        zoom = SIDE / max(target.shape[1:])
        size = [max(1, round(zoom * side)) for side in target.shape[1:]]
        large = nn.functional.interpolate(target[None], size, mode="bilinear", align_corners=False)[0]
        picture = large.double().numpy()
        value = picture.max(0)  # lips are lighter in this than in luma
        dark = value < value.mean() - DARKER * value.std()
        shapes = remove_specks((edge_lines(picture, THICK, FAINT) > INKED) & dark, SPECK * value.size)
        random = np.random.default_rng(int(torch.randint(2**31, (1,), generator=generator)))
        curve, half = fill_shape(shapes, n, BROADEST * SIDE, random)
        return strokes_of(curve, 2 * half, half > 0, rgb_of(self.color), n).moved(zoom=1 / zoom)
