"""The order of strokes, bottom to top, follows from what is seen where two of them meet."""

import heapq
from typing import Any

import numpy as np
from numpy.typing import NDArray

from brushexp_recovery.finding import OVER_UNIT, Regions
from brushexp_recovery.network import OVER

Array = NDArray[Any]


def evidence_of(regions: Regions) -> tuple[Array, Array]:
    """Weigh, of pairs (P, 2) of regions that meet, the evidence (P,) that the second lies above the first."""
    labels, count = regions.labels, len(regions.chance)
    height, width = labels.shape
    keys, values = [np.empty(0, np.int64)], [np.empty(0)]
    for channel, offset in enumerate(OVER):
        dy, dx = (round(step / regions.zoom) or int(np.sign(step)) for step in offset)
        left, right = max(0, -dx), width - max(0, dx)
        if dy >= height or left >= right:
            continue
        here, there = labels[: height - dy, left:right], labels[dy:, left + dx : right + dx]
        differ = (here != there) & (here >= 0) & (there >= 0)
        a, b = here[differ].astype(np.int64), there[differ]
        value = regions.over[channel, : height - dy, left:right][differ] / OVER_UNIT
        keys.append(np.minimum(a, b) * count + np.maximum(a, b))
        values.append(np.where(a < b, value, -value))
    pair, place = np.unique(np.concatenate(keys), return_inverse=True)
    number = np.bincount(place, minlength=len(pair))
    mean = np.bincount(place, np.concatenate(values), minlength=len(pair)) / np.maximum(number, 1)
    return np.stack([pair // max(count, 1), pair % max(count, 1)], 1), mean * np.sqrt(number)


def stack(count: int, pairs: Array, evidence: Array) -> Array:
    """Order ``count`` strokes bottom to top, against as little evidence as can be.

    After Eades, Lin and Smyth (1993): from the bottom the stroke with least evidence of lying on one that is left.
    """
    above: list[dict[int, float]] = [{} for _ in range(count)]
    below: list[dict[int, float]] = [{} for _ in range(count)]
    for (i, j), value in zip(pairs.tolist(), evidence.tolist(), strict=True):
        low, high = (i, j) if value >= 0 else (j, i)
        above[low][high] = below[high][low] = abs(value)
    need = np.array([sum(one.values()) for one in below])
    balance = need - np.array([sum(one.values()) for one in above])
    heap = [(balance[k], k) for k in range(count)]
    heapq.heapify(heap)
    free = [k for k in range(count) if need[k] <= 1e-9]
    done, order = np.zeros(count, bool), list[int]()
    while len(order) < count:
        if free:
            k = free.pop()
        else:
            value, k = heapq.heappop(heap)
            if value != balance[k]:
                continue
        if done[k]:
            continue
        done[k] = True
        order.append(k)
        for other, weight in above[k].items():
            need[other] -= weight
            balance[other] -= weight
            if not done[other] and need[other] <= 1e-9:
                free.append(other)
            heapq.heappush(heap, (balance[other], other))
        for other, weight in below[k].items():
            balance[other] += weight
            heapq.heappush(heap, (balance[other], other))
    return np.array(order, int)
