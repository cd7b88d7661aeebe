"""Pictures of a whole canvas: its strokes by direction, and how parallel they are from place to place."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from brushexp.analysis.columns import Array
from brushexp.analysis.summary import Analysis
from brushexp.strokes.bezier import curve_of
from brushexp.strokes.measures import centre_of, direction_of, mean_direction, nearest_strokes

STROKES_SIDE = 900  # pixels: longer side of the strokes as they are drawn
LEAST_AROUND = 3  # strokes within the radius of a place below which nothing is said of it
CHROMA, LIGHTNESS, LIGHTNESS_SPAN = 32.0, 64.0, 12.0  # of the colours of directions, CIE LCh; more is not in sRGB
LEVEL_HUE = math.radians(85)  # of level strokes, ochre; upright ones are blue


def direction_colors(angle: Array) -> Array:
    """Colours (N, 3) of directions in radians: hues go round once in half a turn; grey for NaN.

    Level strokes are lighter than upright ones, and the hues between which they differ are those that most of the
    colour-blind tell apart.
    """
    from skimage.color import lab2rgb  # noqa: PLC0415  (slow to import)

    known = np.isfinite(angle)
    turn = 2 * np.where(known, angle, 0.0)
    chroma = np.where(known, CHROMA, 0.0)
    lightness = LIGHTNESS + LIGHTNESS_SPAN * np.where(known, np.cos(turn), 0.0)
    lab = np.stack([lightness, chroma * np.cos(turn + LEVEL_HUE), chroma * np.sin(turn + LEVEL_HUE)], axis=-1)
    colors: Array = np.clip(lab2rgb(lab[None])[0], 0, 1)
    return colors


@torch.no_grad()
def stroke_map(found: Analysis) -> NDArray[np.float32]:
    """The strokes (H, W, 3) as they lie over each other, in the colours of their directions, on white."""
    from brushexp.plugins.blend.tiled import Tiled  # noqa: PLC0415  (slow to import)
    from brushexp.plugins.renderer.analytic import Analytic  # noqa: PLC0415

    zoom = STROKES_SIDE / max(found.size)
    size = (max(1, round(found.size[0] * zoom)), max(1, round(found.size[1] * zoom)))
    color = torch.from_numpy(direction_colors(found.measures.orientation)).float()
    strokes = replace(found.strokes.map(Tensor.float), color=color).moved(zoom=zoom)
    above = torch.from_numpy(found.depth).argsort(descending=True)
    picture: NDArray[np.float32] = Tiled()(Analytic()(strokes), above, size, torch.ones(3)).image.numpy()
    return picture.transpose(1, 2, 0).clip(0, 1)


@torch.no_grad()
def coherence_map(found: Analysis, cells: int) -> tuple[Array, Array]:
    """Mean doubled direction of the nearest strokes to places in a grid over the canvas, ``cells`` on its longer side.

    Returns:
        Places (h, w, 2) in pixels, and directions (h, w, 2), as long as the coherence; NaN where fewer than
        ``LEAST_AROUND`` strokes are within the radius of the analysis.
    """
    from scipy.spatial import cKDTree  # noqa: PLC0415  (slow to import)

    height, width = found.size
    step = max(height, width) / cells
    columns, rows = max(1, round(width / step)), max(1, round(height / step))
    x, y = (np.arange(columns) + 0.5) * width / columns, (np.arange(rows) + 0.5) * height / rows
    points = np.stack(np.meshgrid(x, y), axis=-1)
    curve = curve_of(found.strokes.map(Tensor.double))
    centre, places = centre_of(curve), torch.from_numpy(points.reshape(-1, 2))
    mean = mean_direction(direction_of(curve), nearest_strokes(places, centre, exclude_self=False)).numpy()
    near = cKDTree(centre.numpy()).query_ball_point(places.numpy(), found.radius, return_length=True)
    mean[near < LEAST_AROUND] = np.nan
    return points, mean.reshape(rows, columns, 2)
