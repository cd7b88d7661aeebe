"""Brushes that no training has seen: a palette knife and a dry brush, as pictures of single strokes."""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d, grey_closing

from brushexp_recovery.outlines import points_of
from brushexp_recovery.synthesis import Laid
from brushexp_recovery.synthesis_looks import Drawn

Array = NDArray[Any]

MARGIN = 2.0  # pixels around a stroke
SOFT = 0.7  # pixels of an edge
TRACKS = 24  # streaks across a brush
LONG = 64  # samples along it
NEAR = 97  # points of a curve among which the nearest is taken
BRUSHES = ("knife", "dry")


def draw_with(brush: str, laid: Laid, random: np.random.Generator) -> Drawn:
    """Draw strokes in windows as large as they are, a texel a pixel: ``knife`` or ``dry``."""
    low, high = laid.curve.min(1) - laid.width[:, None], laid.curve.max(1) + laid.width[:, None]
    position, extent = 0.5 * (low + high), (high - low).max(1) + 2 * MARGIN
    side = np.ceil(extent).astype(int)
    windows = [
        _window(brush, curve - place + 0.5 * edge, width, color, edge, random)
        for curve, place, width, color, edge in zip(laid.curve, position, laid.width, laid.color, side, strict=True)
    ]
    first = np.concatenate([[0], np.cumsum(side**2)[:-1]])
    texels = np.concatenate(windows).astype(np.float32)
    return Drawn(texels, first, side, position, side.astype(float), laid.curve, laid.width)


def _window(brush: str, curve: Array, width: float, color: Array, side: int, random: np.random.Generator) -> Array:
    """Draw one stroke (side * side, 5): colour times alpha, alpha, and alpha with its gaps closed."""
    along, across = coordinates(curve, side)
    inside = np.clip((0.5 * width - np.abs(across)) / SOFT + 0.5, 0, 1)
    ends = np.clip(np.minimum(along, 1 - along) * np.linalg.norm(curve[2] - curve[0]) / SOFT + 0.5, 0, 1)
    streak = streaks(random)[
        np.clip((along * LONG).astype(int), 0, LONG - 1),
        np.clip(((across / width + 0.5) * TRACKS).astype(int), 0, TRACKS - 1),
    ]
    alpha = inside * ends
    paint = np.clip(color * (1 + 0.12 * streak[..., None]), 0, 1)
    if brush == "dry":  # paint runs out, and leaves gaps between the bristles
        alpha = alpha * np.clip(0.9 + 0.9 * streak - 1.1 * along**2, 0, 1)
    closed = grey_closing(alpha, size=5)
    picture = np.concatenate([paint * alpha[..., None], alpha[..., None], closed[..., None]], -1)
    return picture.reshape(-1, 5)


def coordinates(curve: Array, side: int) -> tuple[Array, Array]:
    """Compute for each pixel (side, side) the share of the way along a curve (3, 2), and pixels aside."""
    x, y = np.meshgrid(np.arange(side) + 0.5, np.arange(side) + 0.5)
    places, points = np.stack([x, y], -1), points_of(curve[None], NEAR)[0]
    nearest = ((places[:, :, None] - points) ** 2).sum(-1).argmin(-1)
    way = np.gradient(points, axis=0)
    way /= np.maximum(np.linalg.norm(way, axis=1, keepdims=True), 1e-9)
    away = places - points[nearest]
    ahead = (away * way[nearest]).sum(-1) / max(float(np.linalg.norm(curve[2] - curve[0])), 1e-6)
    across = away[..., 1] * way[nearest, 0] - away[..., 0] * way[nearest, 1]
    return nearest / (NEAR - 1) + ahead, across


def streaks(random: np.random.Generator) -> Array:
    """Draw a texture (LONG, TRACKS) of mean 0 and deviation 1 that runs along the brush."""
    noise = gaussian_filter1d(random.normal(size=(LONG, TRACKS)), 8, axis=0) + 0.2 * random.normal(size=TRACKS)
    return (noise - noise.mean()) / noise.std()
