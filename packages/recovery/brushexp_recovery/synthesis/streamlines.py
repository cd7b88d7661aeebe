"""Trace curves along a direction field."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from brushexp_recovery.synthesis.hand import TRACE_STEPS, Hand, Random

Array = NDArray[Any]

SURE_STEPS = 4  # number of steps that are always taken


def curves_along(angles: Array, picture: Array, places: Array, half: Array, hand: Hand, random: Random) -> Array:
    """Trace curves (n, 3, 2) along a direction field, from ``places`` (n, 2) for ``half`` pixels in both directions."""
    n = len(places)
    x, y = places.astype(int).T
    angle = angles[y, x]
    back, ahead = (_trace(angles, picture, places, angle + turn, half, hand) - places for turn in (np.pi, 0.0))
    sector = np.pi / hand.directions
    turn = sector * np.round(angle / sector) + np.radians(hand.shaky) * random.normal(size=n) - angle
    start, end = places + _rotate(back, turn), places + _rotate(ahead, turn)
    return np.stack([start, 2 * places - 0.5 * (start + end), end], 1)


def _rotate(vectors: Array, turn: Array) -> Array:
    """Rotate vectors (n, 2) by angles (n,)."""
    x, y = vectors.T
    cosine, sine = np.cos(turn), np.sin(turn)
    return np.stack([x * cosine - y * sine, x * sine + y * cosine], 1)


def _trace(angles: Array, picture: Array, places: Array, angle: Array, half: Array, hand: Hand) -> Array:
    """Follow the direction field from ``places`` (n, 2) for ``half`` (n,) pixels, initially towards ``angle`` (n,)."""
    height, width = angles.shape
    step = np.maximum(half / TRACE_STEPS, 1e-3)[:, None]
    place = places.copy()
    x, y = places.astype(int).T
    first_color = picture[y, x]
    for number in range(TRACE_STEPS):
        x = np.clip(place[:, 0].astype(int), 0, width - 1)
        y = np.clip(place[:, 1].astype(int), 0, height - 1)
        if hand.clip and number >= SURE_STEPS:
            step = np.where(np.abs(picture[y, x] - first_color).max(1, keepdims=True) > hand.clip, 0, step)
        here = angles[y, x]
        here = here + np.pi * np.round((angle - here) / np.pi)
        angle = angle + np.clip(here - angle, -hand.turn, hand.turn)
        place = place + step * np.stack([np.cos(angle), np.sin(angle)], 1)
    return place
