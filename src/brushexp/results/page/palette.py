"""The colours of a painting as a few, by how much of it each covers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from brushexp.results.page.replay import hex_of

COLORS = 12
ROUNDS = 12  # of k-means: the colours no longer move by what can be seen
ALIKE = 0.02  # in Oklab: colours that are nearer to each other can hardly be told apart
LEAST = 0.002  # share of a colour that is shown


@dataclass(frozen=True)
class Swatch:
    """One colour, and the share of the paint that is like it."""

    color: str
    share: float


def palette(colors: np.ndarray, weights: np.ndarray, most: int = COLORS) -> list[Swatch]:
    """At most so many colours, from dark to light.

    k-means in Oklab (Ottosson, 2020), where distances are what people see; begun with the colours that are farthest
    from those chosen before, so that small accents have a chance and no chance is involved.

    Args:
        colors: (N, 3) RGB in [0, 1].
        weights: (N,) how much each counts, >= 0.
        most: how many.
    """
    kept = weights > 0
    if not kept.any():
        return []
    lab, rgb, weights = oklab(colors[kept]), colors[kept], weights[kept]
    centers = _spread(lab, weights, most)
    for _ in range(ROUNDS):
        label = _nearest(lab, centers)
        mass = np.bincount(label, weights, len(centers))
        sums = np.stack([np.bincount(label, weights * lab[:, c], len(centers)) for c in range(3)], axis=1)
        centers = np.where(mass[:, None] > 0, sums / np.maximum(mass, 1e-12)[:, None], centers)
    label = _nearest(lab, centers)
    mass = np.bincount(label, weights, len(centers))
    means = np.stack([np.bincount(label, weights * rgb[:, c], len(centers)) for c in range(3)], axis=1)
    shares = mass / mass.sum()
    order = [k for k in centers[:, 0].argsort(kind="stable") if shares[k] >= LEAST]
    return [Swatch(hex_of(means[k] / mass[k]), float(shares[k])) for k in order]


def oklab(rgb: np.ndarray) -> np.ndarray:
    """Oklab (N, 3) of display-referred sRGB (N, 3) in [0, 1]."""
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((np.maximum(rgb, 0) + 0.055) / 1.055) ** 2.4)
    cones = linear @ np.array(
        [
            [0.4122214708, 0.2119034982, 0.0883024619],
            [0.5363325363, 0.6806995451, 0.2817188376],
            [0.0514459929, 0.1073969566, 0.6299787005],
        ]
    )
    return np.cbrt(cones) @ np.array(
        [
            [0.2104542553, 1.9779984951, 0.0259040371],
            [0.7936177850, -2.4285922050, 0.7827717662],
            [-0.0040720468, 0.4505937099, -0.8086757660],
        ]
    )


def _spread(lab: np.ndarray, weights: np.ndarray, most: int) -> np.ndarray:
    """Colours far from each other, the heaviest first."""
    chosen = [int(weights.argmax())]
    away = np.full(len(lab), np.inf)
    while len(chosen) < most:
        away = np.minimum(away, ((lab - lab[chosen[-1]]) ** 2).sum(1))
        far = int((away * np.sqrt(weights)).argmax())
        if away[far] < ALIKE**2:
            break
        chosen.append(far)
    return lab[chosen]


def _nearest(lab: np.ndarray, centers: np.ndarray) -> np.ndarray:
    return ((lab[:, None] - centers) ** 2).sum(2).argmin(1)
