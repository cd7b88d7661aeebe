"""Two neighbouring regions are described, so that a judge can say whether they are one stroke."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from brushexp_recovery.regions import GROUPS

Array = NDArray[Any]

FARTHEST = 20.0  # that a feature may be from 0


class Described(NamedTuple):
    """Means and shapes of N regions."""

    mean: Array  # (N, SUMS)
    length: Array  # (N,) pixels, of the rectangle with the same moments
    width: Array  # (N,)
    spread: Array  # (N,) pixels by which opinions of the centre differ
    direction: Array  # (N, 2) variance along x less that along y, twice the covariance


def describe(sums: Array) -> Described:
    """Describe regions by their sums (N, SUMS)."""
    mean = sums / sums[:, :1]
    xx = mean[:, 3] - mean[:, 1] ** 2 + 1 / 12
    yy = mean[:, 5] - mean[:, 2] ** 2 + 1 / 12
    xy = mean[:, 4] - mean[:, 1] * mean[:, 2]
    half = np.sqrt(0.25 * (xx - yy) ** 2 + xy**2)
    length = np.sqrt(12 * (0.5 * (xx + yy) + half))
    width = np.sqrt(12 * np.maximum(0.5 * (xx + yy) - half, 0.05))
    spread = np.sqrt(np.maximum(mean[:, 14] - mean[:, 12] ** 2 - mean[:, 13] ** 2, 0.01))
    return Described(mean, length, width, spread, np.stack([xx - yy, 2 * xy], 1))


def pair_features(sums: Array, pairs: Array, between: Array) -> Array:
    """Describe pairs (P, 2) of regions, with the affinities (P, 8) between them: (P, F) float32."""
    swap = sums[pairs[:, 0], 0] > sums[pairs[:, 1], 0]
    pairs = np.where(swap[:, None], pairs[:, ::-1], pairs)
    a, b = sums[pairs[:, 0]], sums[pairs[:, 1]]  # the smaller and the larger one
    small, large, both = describe(a), describe(b), describe(a + b)
    area_a, area_b, area = a[:, 0], b[:, 0], a[:, 0] + b[:, 0]
    total, count = between[:, :GROUPS], between[:, GROUPS:]
    wide, long = np.exp(both.mean[:, 17]), np.exp(both.mean[:, 18])
    filled, color = np.log(area / (wide * long)), np.abs(small.mean[:, 6:9] - large.mean[:, 6:9])
    turn = [np.hypot(*one.mean[:, 15:17].T) + 1e-3 for one in (small, large)]
    agree = (small.mean[:, 15:17] * large.mean[:, 15:17]).sum(1) / (turn[0] * turn[1])
    gap = np.linalg.norm(small.mean[:, 12:14] - large.mean[:, 12:14], axis=1)
    apart = np.linalg.norm(small.mean[:, 1:3] - large.mean[:, 1:3], axis=1)
    columns = [
        *((total + 0.25) / (count + 0.5)).T, *np.log1p(count).T, (total.sum(1) + 0.25) / (count.sum(1) + 0.5),
        np.log(area_a), np.log(area_b), *color.T, np.sqrt((color**2).sum(1)), _grain(small), _grain(large),
        np.log((gap + 1) / wide), gap / (small.spread + large.spread), np.log(small.spread / wide),
        np.log(large.spread / wide), *turn, agree, along(both), np.abs(small.mean[:, 17] - large.mean[:, 17]),
        np.abs(small.mean[:, 18] - large.mean[:, 18]), filled, both.mean[:, 19],
        filled - np.log(np.maximum(both.mean[:, 19], 0.05)), np.log(both.length / long), np.log(both.width / wide),
        np.log(small.length / long), np.log(large.length / long), np.log(small.width / wide),
        np.log(large.width / wide), np.log(both.length / large.length), np.log(both.width / large.width),
        np.log(area / (both.length * both.width)), np.log(area_b / (large.length * large.width)),
        np.log(apart / wide + 1e-3), np.log((count[:, 0] + 1) / np.sqrt(area_a)), small.mean[:, 20],
        large.mean[:, 20], both.mean[:, 17],
    ]  # fmt: skip
    return bounded(columns)


def along(one: Described) -> Array:
    """Compare (N,) the direction of regions with what the network says of it, -1 to 1."""
    told = one.mean[:, 15:17]
    norms = (np.linalg.norm(one.direction, axis=1) + 1e-3) * (np.linalg.norm(told, axis=1) + 1e-3)
    return (one.direction * told).sum(1) / norms


def bounded(columns: list[Array]) -> Array:
    """Put features together, (N, F) float32 without infinities."""
    table = np.nan_to_num(np.stack(columns, 1), nan=0.0, posinf=FARTHEST, neginf=-FARTHEST)
    return table.astype(np.float32)


def _grain(one: Described) -> Array:
    """Measure (N,) how much the colour of regions varies, in CIELAB."""
    return np.sqrt(np.maximum(one.mean[:, 9:12] - one.mean[:, 6:9] ** 2, 0.01)).mean(1)
