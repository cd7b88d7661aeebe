"""The colours of a painting as a few swatches, by how much of it each covers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from brushexp.pictures.palette import nearest_ink, palette, to_lab
from brushexp.results.page.replay import hex_of

SWATCHES = 12
SMALLEST_SHARE = 0.002  # of a colour that is shown
COARSE_LEVELS = 31  # of a channel, in which swatches are searched for: so a hundred thousand strokes are soon done


@dataclass(frozen=True)
class Swatch:
    """One colour as ``#rrggbb``, and the share of the paint that is like it."""

    color: str
    share: float


def swatches_of(colors: np.ndarray, weights: np.ndarray) -> list[Swatch]:
    """At most ``SWATCHES`` colours, from dark to light: the means of clusters in CIELAB.

    Args:
        colors: (N, 3) sRGB in [0, 1].
        weights: (N,) how much each counts, >= 0.
    """
    colors, weights = colors[weights > 0], weights[weights > 0]
    if not len(weights):
        return []
    coarse, place = np.unique((colors * COARSE_LEVELS).round(), axis=0, return_inverse=True)
    centers = palette(to_lab(coarse / COARSE_LEVELS), np.bincount(place.ravel(), weights), SWATCHES)
    label = nearest_ink(to_lab(colors), centers)
    mass = np.bincount(label, weights, len(centers))
    sums = np.stack([np.bincount(label, weights * channel, len(centers)) for channel in colors.T], axis=1)
    kept = [k for k in centers[:, 0].argsort(kind="stable") if mass[k] >= SMALLEST_SHARE * mass.sum()]
    return [Swatch(hex_of(sums[k] / mass[k]), float(mass[k] / mass.sum())) for k in kept]
