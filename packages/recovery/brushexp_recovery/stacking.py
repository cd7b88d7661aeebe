"""The order of strokes, bottom to top, follows from what is seen where two of them meet."""

import heapq
from typing import Any

import numpy as np
from numpy.typing import NDArray

from brushexp_recovery.curves import Fitted
from brushexp_recovery.finding import OVER_UNIT, Regions
from brushexp_recovery.network import OVER
from brushexp_recovery.outlines import covers_of

Array = NDArray[Any]

SOLID = 0.5  # share of a pixel that a stroke covers
FEW = 4  # pixels of an overlap that say little


def meetings_of(regions: Regions, fitted: Fitted) -> tuple[Array, Array]:
    """Describe pairs (P, 2) of regions that meet by what speaks for the second above the first.

    Features (P, `ORDER_FEATURES`) change their sign if a pair is turned over: what the network says where they meet,
    weighed by the root of its pixels, and softly counted; by how much more of the second is seen, by the network's
    opinion and by the area that its length and width promise; whose pixels lie where the strokes drawn whole would
    overlap (an outline that goes on belongs to the upper one; Kanizsa, 1979); and how much wider, larger and surer the
    second is, since painters go from broad to fine.
    """
    pairs, place, said = _sides(regions)
    number = np.bincount(place, minlength=len(pairs))
    mean, soft = (
        np.bincount(place, values, minlength=len(pairs)) / np.maximum(number, 1) for values in (said, np.tanh(said / 2))
    )
    lower, upper = pairs.T
    area = np.maximum(np.bincount(regions.labels[regions.labels >= 0], minlength=len(regions.chance)), 1)
    each = np.stack([
        regions.told[:, 6], np.log(area) - regions.told[:, 4:6].sum(1), regions.told[:, 4], np.log(area), regions.chance
    ])  # fmt: skip
    columns = [
        mean * np.sqrt(number),
        soft,
        *_crossings(regions.labels, pairs, fitted),
        *(each[:, upper] - each[:, lower]),
    ]
    return pairs, np.stack(columns, 1)


def _sides(regions: Regions) -> tuple[Array, Array, Array]:
    """List pairs (P, 2) of regions that meet; of each meeting (M,) its pair, and the log-odds of the second above."""
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
    return np.stack([pair // max(count, 1), pair % max(count, 1)], 1), place, np.concatenate(values)


def _crossings(labels: Array, pairs: Array, fitted: Fitted) -> tuple[Array, Array]:
    """Compare, where two strokes (P,) drawn whole overlap, the pixels of either: as a share, and times their root."""
    covers = covers_of(fitted.curve, fitted.width, (labels.shape[0], labels.shape[1]))
    share, seen = np.zeros(len(pairs)), np.zeros(len(pairs))
    for number, (lower, upper) in enumerate(pairs.tolist()):
        one, two = covers[lower], covers[upper]
        if one is None or two is None:
            continue
        box = tuple(slice(max(a.start, b.start), min(a.stop, b.stop)) for a, b in zip(one[0], two[0], strict=True))
        if any(part.start >= part.stop for part in box):
            continue
        parts = [cover[_within(box, place)] >= SOLID for place, cover in (one, two)]
        there = labels[box][parts[0] & parts[1]]
        above, below = (there == upper).sum(), (there == lower).sum()
        share[number], seen[number] = (above - below) / (above + below + FEW), above + below
    return share, share * np.sqrt(seen)


def _within(box: tuple[slice, ...], place: tuple[slice, slice]) -> tuple[slice, ...]:
    """Say where a box lies in a larger one."""
    return tuple(slice(a.start - b.start, a.stop - b.start) for a, b in zip(box, place, strict=True))


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
