"""Choose the positions of strokes in a picture."""
# mypy: allow-untyped-defs

from typing import Any

import numpy as np
from numpy.typing import NDArray

from brushexp.contracts.kernels import function
from brushexp_recovery.synthesis.hand import Random

Array = NDArray[Any]

CANDIDATES = 40  # number of candidate places per stroke


def scatter(n: int, weight: Array, random: Random) -> Array:
    """Spread ``n`` points x, y (n, 2) evenly, but more densely where ``weight`` (H, W) is larger (Poisson disks)."""
    if n == 0:
        return np.empty((0, 2))
    height, width = weight.shape
    pick = random.choice(height * width, CANDIDATES * n, p=(weight / weight.sum()).ravel())
    place = np.stack([pick % width, pick // width], 1) + random.random((len(pick), 2))
    local = np.sqrt(weight.mean() / weight.ravel()[pick])
    radius = 0.9 * np.sqrt(height * width / n)
    while (chosen := _keep_apart(place, local * radius, n))[-1] < 0:
        radius *= 0.9
    return place[chosen]


def on_grid(n: int, size: tuple[int, int], random: Random) -> Array:
    """Spread ``n`` points x, y (n, 2) on a jittered grid over a picture (H, W), in random order."""
    height, width = size
    rows = max(1, round(np.sqrt(n * height / width)))
    columns = -(-n // rows)
    cells = np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), -1).reshape(-1, 2)
    place = (cells + random.uniform(0.25, 0.75, cells.shape)) * [width / max(columns, 1), height / rows]
    return random.permutation(place)[:n]


@function
def _keep_apart(place, distance, n):
    """Choose the indices of the first ``n`` points that are far enough from those chosen before; pad with -1."""
    chosen = np.full(n, -1)
    count = 0
    for i in range(len(place)):
        free = True
        for k in range(count):
            dx, dy = place[chosen[k], 0] - place[i, 0], place[chosen[k], 1] - place[i, 1]
            if dx * dx + dy * dy <= distance[i] * distance[i]:
                free = False
                break
        if free:
            chosen[count] = i
            count += 1
            if count == n:
                break
    return chosen
