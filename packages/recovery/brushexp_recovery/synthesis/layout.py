"""Lay out the strokes that paint a picture: their curves, widths and colours, bottom to top."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from brushexp_recovery.synthesis.colors import pick_colors
from brushexp_recovery.synthesis.direction_field import add_hatching, detail_of, edge_directions
from brushexp_recovery.synthesis.hand import Hand, Random
from brushexp_recovery.synthesis.placement import on_grid, scatter
from brushexp_recovery.synthesis.streamlines import curves_along

Array = NDArray[Any]

ROUND_AREA = 0.8  # approximate area of the round ends of a stroke in squared widths
DETAIL_WEIGHT = 0.6  # weight of detail in the density of each finer layer
ROW_PITCH = (0.7, 1.05)  # range of the distance between neighbours in a row, in widths
ROW_SCATTER = 0.5  # displacement of neighbours along the strokes, in widths
MOST_TAPER = 0.6  # maximum taper as a share of the width


@dataclass(frozen=True)
class StrokeLayout:
    """N strokes placed on a canvas, bottom to top."""

    curve: Array  # (N, 3, 2) control points in pixels, x to the right, y down
    width: Array  # (N,) pixels
    color: Array  # (N, 3) sRGB
    sway: Array  # (N,) sideways displacement of an S-bend in pixels, half-way to each end
    taper: Array  # (N,) relative change of width from the middle to an end

    def __len__(self) -> int:
        return len(self.width)


def lay_strokes(picture: Array, n: int, hand: Hand, random: Random) -> StrokeLayout:
    """Place ``n`` strokes so that they paint a ``picture`` (H, W, 3) in [0, 1] in the manner of ``hand``."""
    size = picture.shape[:2]
    area = size[0] * size[1]
    ends = np.cumsum([0.0, *(layer.share for layer in hand.layers)]) * n
    counts = np.diff(np.round(ends).astype(int))
    relative = np.repeat([layer.width for layer in hand.layers], counts) * np.exp(hand.uneven * random.normal(size=n))
    median, spread = hand.aspect
    aspect = np.clip(np.exp(np.log(median) + spread * random.normal(size=n)), *hand.limits)
    width = relative * np.sqrt(hand.cover * area / (relative**2 * (aspect + ROUND_AREA)).sum())
    pitch = np.sqrt(area / n)
    angles = add_hatching(edge_directions(picture, max(3.0, 0.45 * pitch)), hand.hatch, random)
    places = _place_layers(picture, counts, pitch, hand, random)
    painted = places  # where colours are picked
    if hand.row > 1:
        painted, places = _line_up(places, angles, width, hand.row, random)
    curve = curves_along(angles, picture, places, 0.5 * aspect * width, hand, random)
    color = pick_colors(picture, painted, width, hand, random)
    sway = hand.sway * width * random.normal(size=n)
    taper = np.clip(hand.taper * random.normal(size=n), -MOST_TAPER, MOST_TAPER)
    return StrokeLayout(curve, width, color, sway, taper)


def _line_up(places: Array, angles: Array, width: Array, most: int, random: Random) -> tuple[Array, Array]:
    """Move strokes into rows of up to ``most`` strokes side by side, perpendicular to a direction field (H, W).

    Returns the position of the first stroke in each stroke's row (n, 2), and the position of the stroke itself (n, 2).
    """
    n = len(places)
    size = np.array(angles.shape[::-1])
    lengths = random.integers(1, most + 1, n)
    first = np.repeat(np.arange(n), lengths)[:n]
    number = np.arange(n) - np.searchsorted(first, first)
    start = places[first]
    x, y = start.astype(int).T
    normal = np.stack([-np.sin(angles[y, x]), np.cos(angles[y, x])], 1)
    apart = (number * random.uniform(*ROW_PITCH, n) * width)[:, None]
    scatter_along = (ROW_SCATTER * width * random.normal(size=n))[:, None] * np.stack([normal[:, 1], -normal[:, 0]], 1)
    moved = np.clip(start + apart * normal + scatter_along, 0, size - 1)
    return start, moved


def _place_layers(picture: Array, counts: Array, pitch: float, hand: Hand, random: Random) -> Array:
    """Choose stroke positions (n, 2) for each layer, placing finer strokes mostly where there is detail."""
    size = picture.shape[:2]
    if hand.even:
        return np.concatenate([on_grid(count, size, random) for count in counts])
    detail = detail_of(picture, pitch)
    mean = max(detail.mean(), 1e-6)
    weights = [1 + number * DETAIL_WEIGHT * detail / mean for number in range(len(counts))]
    return np.concatenate([scatter(count, weight, random) for count, weight in zip(counts, weights, strict=True)])
