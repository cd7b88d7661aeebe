"""Draw single strokes with brushes that are not used in training: a palette knife and a dry brush."""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d, grey_closing

from brushexp_recovery.curves.bezier import chords_of, points_on
from brushexp_recovery.synthesis.layout import StrokeLayout
from brushexp_recovery.synthesis.windows import StrokeWindows, Texel, join_windows

Array = NDArray[Any]

MARGIN = 2.0  # margin around a stroke in pixels
EDGE_WIDTH = 0.7  # pixels over which an edge rises
TRACKS = 24  # number of streaks across a brush
SAMPLES = 64  # number of samples of a streak along a stroke
POINTS = 97  # number of points on a curve among which the nearest is chosen
CLOSED_GAP = 5  # maximum width in pixels of gaps that belong to the stroke's region
BRUSHES = ("knife", "dry")


def draw_with(brush: str, layout: StrokeLayout, random: np.random.Generator) -> StrokeWindows:
    """Draw strokes with a palette knife or a dry brush, each in a window of its own size with one texel per pixel."""
    low, high = layout.curve.min(1) - layout.width[:, None], layout.curve.max(1) + layout.width[:, None]
    position, extent = 0.5 * (low + high), (high - low).max(1) + 2 * MARGIN
    side = np.ceil(extent).astype(int)
    curves = layout.curve - position[:, None] + 0.5 * side[:, None, None]
    windows = [
        _draw_window(brush, curves[k], layout.width[k], layout.color[k], side[k], random) for k in range(len(layout))
    ]
    return join_windows(windows, side, position, layout)


def _draw_window(brush: str, curve: Array, width: float, color: Array, side: int, random: np.random.Generator) -> Array:
    """Draw one stroke along a curve (3, 2), and return its texels (side * side, len(Texel))."""
    along, across = coordinates(curve, side)
    inside = np.clip((0.5 * width - np.abs(across)) / EDGE_WIDTH + 0.5, 0, 1)
    ends = np.clip(np.minimum(along, 1 - along) * _chord_length(curve) / EDGE_WIDTH + 0.5, 0, 1)
    row = np.clip((along * SAMPLES).astype(int), 0, SAMPLES - 1)
    track = np.clip(((across / width + 0.5) * TRACKS).astype(int), 0, TRACKS - 1)
    streak = draw_streaks(random)[row, track]
    alpha = inside * ends
    paint = np.clip(color * (1 + 0.12 * streak[..., None]), 0, 1)
    if brush == "dry":  # paint runs out and leaves gaps between bristles
        alpha = alpha * np.clip(0.9 + 0.9 * streak - 1.1 * along**2, 0, 1)
    closed = grey_closing(alpha, size=CLOSED_GAP)
    texels = np.concatenate([paint * alpha[..., None], alpha[..., None], closed[..., None], alpha[..., None]], -1)
    return texels.reshape(-1, len(Texel))


def coordinates(curve: Array, side: int) -> tuple[Array, Array]:
    """Compute each pixel's position along a curve (3, 2), 0 to 1, and offset across it in pixels, both (side, side)."""
    x, y = np.meshgrid(np.arange(side) + 0.5, np.arange(side) + 0.5)
    places, points = np.stack([x, y], -1), points_on(curve[None], POINTS)[0]
    nearest = ((places[:, :, None] - points) ** 2).sum(-1).argmin(-1)
    way = np.gradient(points, axis=0)
    way /= np.maximum(np.linalg.norm(way, axis=1, keepdims=True), 1e-9)
    away = places - points[nearest]
    ahead = (away * way[nearest]).sum(-1) / max(_chord_length(curve), 1e-6)
    across = away[..., 1] * way[nearest, 0] - away[..., 0] * way[nearest, 1]
    return nearest / (POINTS - 1) + ahead, across


def _chord_length(curve: Array) -> float:
    """Compute the chord length of a curve (3, 2)."""
    (chord,) = chords_of(curve[None])
    return float(np.linalg.norm(chord))


def draw_streaks(random: np.random.Generator) -> Array:
    """Generate a texture (`SAMPLES`, `TRACKS`) of streaks along a stroke, with mean 0 and standard deviation 1."""
    noise = gaussian_filter1d(random.normal(size=(SAMPLES, TRACKS)), 8, axis=0) + 0.2 * random.normal(size=TRACKS)
    return (noise - noise.mean()) / noise.std()
