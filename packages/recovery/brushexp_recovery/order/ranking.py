"""Rank all strokes, given evidence about the order of pairs."""

import heapq
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]

NOTHING = 1e-9  # evidence up to this is a rounding error


def rank_strokes(count: int, pairs: Array, evidence: Array) -> Array:
    """Order ``count`` strokes bottom to top so that as little evidence as possible contradicts the order.

    ``evidence`` (P,) is the log-odds that the second stroke of a pair (P, 2) is above the first. Strokes are chosen
    greedily from the bottom up (after Eades, Lin and Smyth, 1993). The next stroke is one for which there is no
    evidence that it is above any remaining stroke. If there is no such stroke, the next is the one for which the
    evidence of being above remaining strokes, minus the evidence of being below them, is smallest.

    Returns:
        The numbers of the strokes (count,), bottom to top.
    """
    above, below = _weigh(count, pairs, evidence)
    need = np.array([sum(one.values()) for one in below])  # evidence of lying on remaining strokes
    balance = need - np.array([sum(one.values()) for one in above])
    heap = [(balance[k], k) for k in range(count)]
    heapq.heapify(heap)
    free = [k for k in range(count) if need[k] <= NOTHING]
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
            if not done[other] and need[other] <= NOTHING:
                free.append(other)
            heapq.heappush(heap, (balance[other], other))
        for other, weight in below[k].items():
            balance[other] += weight
            heapq.heappush(heap, (balance[other], other))
    return np.array(order, int)


def _weigh(count: int, pairs: Array, evidence: Array) -> tuple[list[dict[int, float]], list[dict[int, float]]]:
    """Return the evidence for the strokes above each stroke, and for the strokes below it, as dicts keyed by stroke."""
    above: list[dict[int, float]] = [{} for _ in range(count)]
    below: list[dict[int, float]] = [{} for _ in range(count)]
    for (i, j), value in zip(pairs.tolist(), evidence.tolist(), strict=True):
        low, high = (i, j) if value >= 0 else (j, i)
        above[low][high] = below[high][low] = abs(value)
    return above, below
