"""Where a painting differs from its target, as a picture with a legend."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

SCALE_ENDS = (4, 8, 16, 32, 64, 128, 255)  # levels: where a scale may end
QUANTILES = ((0.5, "half"), (0.9, "90 %"), (0.99, "99 %"), (1.0, "all"))
SHARE_ON_SCALE = 0.995  # of the pixels
# Magma by Smith and van der Walt (2015), at equal steps: perceptually even, also in grey and for the colour-blind.
MAGMA = (
    "#000004", "#180f3e", "#451077", "#721f81", "#9f2f7f", "#cd4071", "#f1605d", "#fd9567", "#fec98d", "#fcfdbf",
)  # fmt: skip


@dataclass(frozen=True)
class ErrorMap:
    """Errors of pixels as colours.

    Attributes:
        pixels: (H, W, 3) uint8.
        top: levels (of 255) where the scale ends; larger errors have its last colour.
        above: share of pixels beyond it.
        mean: levels.
        below: how many pixels, in words, have how many levels at most.
    """

    pixels: np.ndarray
    top: int
    above: float
    mean: float
    below: list[tuple[str, float]]


def error_map(painting: np.ndarray, target: np.ndarray) -> ErrorMap:
    """Mean |difference| of the channels of two pictures (H, W, 3) uint8, in levels of 255, on the scale ``MAGMA``."""
    difference = np.abs(painting.astype(np.int16) - target.astype(np.int16)).sum(2, dtype=np.int32)
    counts = np.bincount(difference.ravel(), minlength=766)
    total = counts.cumsum()

    def quantile(share: float) -> float:
        return int(np.searchsorted(total, share * difference.size)) / 3

    end = quantile(SHARE_ON_SCALE)
    top = next((level for level in SCALE_ENDS if level >= end), SCALE_ENDS[-1])
    anchors = np.array([[*bytes.fromhex(color[1:])] for color in MAGMA], float)
    place = np.minimum(np.arange(766) / 3 / top, 1)
    colors = np.stack([np.interp(place, np.linspace(0, 1, len(MAGMA)), anchors[:, c]) for c in range(3)], axis=1)
    above = float(counts[3 * top + 1 :].sum() / difference.size)
    return ErrorMap(
        colors.round().astype(np.uint8)[difference],
        top,
        above,
        float(difference.mean() / 3),
        [(text, quantile(share)) for share, text in QUANTILES],
    )
