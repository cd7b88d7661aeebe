"""Draw the last strokes of a painting: lines along edges, in the darkest and lightest colours that are there."""

from dataclasses import replace

import numpy as np
import torch

from brushexp.contracts.pictures import sampled_at
from brushexp.contracts.strokes import Strokes
from brushexp_media.init.drawing import contours

Array = np.ndarray
DARK, LIGHT = 0.45, 0.6  # means of red, green, blue: lighter places have no dark accents, darker ones no light ones
AROUND, APART = 0.02, 0.06  # deviation of the blur, longer sides, from which accents differ at least by so much


def accents(
    picture: Array, n: int, length: float, width: float, focus: Array | None, *, dark: bool, toward: Array, share: float
) -> Strokes:
    """Trace n lines at the dark or the light side of edges of a picture (3, H, W); those that are neither are unseen.

    ``length`` and ``width`` of the strongest are in pixels. A line has the colour of its place, which goes by a
    ``share`` to the colour ``toward`` (3,).
    """
    from scipy.ndimage import gaussian_filter  # noqa: PLC0415  (slow to import)

    lines = contours(picture if dark else 1 - picture, n, length, width, np.zeros(3), focus)
    around = gaussian_filter(picture.mean(0), AROUND * max(picture.shape))
    places = lines.position.double().numpy().T
    color = sampled_at(picture, *places)
    tone = color.mean(0)
    apart = sampled_at(around, *places) - tone
    seen = (tone < DARK) & (apart > APART) if dark else (tone > LIGHT) & (apart < -APART)
    color = color.T + share * (toward - color.T)
    return replace(lines, color=torch.from_numpy(color).float(), opacity=lines.opacity * torch.from_numpy(seen))
