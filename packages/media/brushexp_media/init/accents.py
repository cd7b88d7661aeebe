"""Draw the last strokes of a painting: accents along edges, darker or lighter than their surroundings."""

from dataclasses import replace

import numpy as np
import torch

from brushexp.contracts.pictures import sample_at
from brushexp.contracts.strokes import Strokes
from brushexp_media.init.contours import contours
from brushexp_media.picture.decolorization import contrast_weights, decolorize

Array = np.ndarray
DARK, LIGHT = 0.45, 0.6  # mean of RGB above which there are no dark accents, and below which no light ones
AROUND, APART = 0.02, 0.06  # standard deviation of the blur in longer sides, and least difference of accents from it


def accents(
    picture: Array, n: int, length: float, width: float, focus: Array | None, *, dark: bool, toward: Array, share: float
) -> Strokes:
    """Trace n lines along the dark or the light side of edges in a picture (3, H, W).

    Lines that are not clearly darker or lighter than their surroundings are invisible. ``length`` and ``width`` are
    the dimensions of the strongest line, in pixels. A line has the picture's colour at its position, shifted by the
    fraction ``share`` towards the colour ``toward`` (3,).
    """
    from scipy.ndimage import gaussian_filter  # noqa: PLC0415  (slow to import)

    shown = picture if dark else 1 - picture
    grey = decolorize(shown, contrast_weights(shown))
    lines = contours(shown, grey, n, length, width, np.zeros(3), focus)
    around = gaussian_filter(picture.mean(0), AROUND * max(picture.shape))
    places = lines.position.double().numpy().T
    color = sample_at(picture, *places)
    tone = color.mean(0)
    apart = sample_at(around, *places) - tone
    seen = (tone < DARK) & (apart > APART) if dark else (tone > LIGHT) & (apart < -APART)
    color = color.T + share * (toward - color.T)
    return replace(lines, color=torch.from_numpy(color).float(), opacity=lines.opacity * torch.from_numpy(seen))
