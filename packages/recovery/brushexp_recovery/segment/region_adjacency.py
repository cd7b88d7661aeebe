"""Build the region adjacency graph, which lists neighbouring regions and their affinities."""
# mypy: allow-untyped-defs

from enum import IntEnum
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from brushexp.contracts.kernels import function
from brushexp_recovery.model.channels import AFFINITY_OFFSETS

Array = NDArray[Any]


class AffinityColumn(IntEnum):
    """Columns with sums of affinities and numbers of pixel pairs, grouped by the distance between the two pixels."""

    SUM_ADJACENT = 0  # sum of affinities
    SUM_3 = 1
    SUM_8 = 2
    SUM_20 = 3
    PAIRS_ADJACENT = 4  # number of pairs
    PAIRS_3 = 5
    PAIRS_8 = 6
    PAIRS_20 = 7


DISTANCE_GROUPS = 4  # 1, 3, 8 and 20 pixels
GROUP_OF_OFFSET = np.array([0, 0, *np.repeat([1, 2, 3], 4)])
SUMS = slice(AffinityColumn.SUM_ADJACENT, AffinityColumn.SUM_20 + 1)
PAIRS = slice(AffinityColumn.PAIRS_ADJACENT, AffinityColumn.PAIRS_20 + 1)

FIRST_ROOM = 32  # initial number of slots for pairs per region
HASH = 0x9E3779B97F4A7C1  # spreads the numbers of pairs over a table (Knuth, 1973)


class Adjacency(NamedTuple):
    """Affinities within S regions, and between the P pairs of neighbouring regions."""

    within: Array  # (S, len(AffinityColumn))
    pairs: Array  # (P, 2) regions, lower number first
    between: Array  # (P, len(AffinityColumn))


def adjacency_of(labels: Array, affinity: Array) -> Adjacency:
    """Sum affinities (len(AFFINITY_OFFSETS), H, W) within and between the regions of a label image (H, W)."""
    count = int(labels.max()) + 1
    room = 2 ** (FIRST_ROOM * count).bit_length()
    within = np.empty((count, len(AffinityColumn)))
    while True:
        keys, between = np.full(room, -1), np.zeros((room, len(AffinityColumn)))
        if _sum_affinities(labels, affinity, np.array(AFFINITY_OFFSETS), GROUP_OF_OFFSET, within, keys, between):
            break
        room *= 2
    used = np.flatnonzero(keys >= 0)
    used = used[np.argsort(keys[used])]
    return Adjacency(within, np.stack([keys[used] // count, keys[used] % count], 1), between[used])


@function
def _sum_affinities(labels, affinity, offsets, group_of_offset, within, keys, between):
    """Sum and count affinities; return False if the pairs fill more than half of their hash table.

    ``keys`` (R,) is the hash table, initially filled with -1; R is a power of 2. A pair of regions is stored as the
    smaller region number times S plus the larger one.
    """
    height, width = labels.shape
    count, room, filled, key, place = len(within), len(keys), 0, -1, 0
    within[:] = 0
    for channel in range(len(offsets)):
        dy, dx = offsets[channel]
        group = group_of_offset[channel]
        for y in range(height - dy):
            for x in range(max(0, -dx), width - max(0, dx)):
                here, there, value = labels[y, x], labels[y + dy, x + dx], affinity[channel, y, x]
                if here == there:
                    within[here, AffinityColumn.SUM_ADJACENT + group] += value
                    within[here, AffinityColumn.PAIRS_ADJACENT + group] += 1
                    continue
                pair = min(here, there) * count + max(here, there)
                if pair != key:  # usually the same as for the previous pixel
                    key, place = pair, (pair * HASH >> 20) & (room - 1)
                    while keys[place] != key and keys[place] >= 0:
                        place = (place + 1) & (room - 1)
                    if keys[place] < 0:
                        keys[place] = key
                        filled += 1
                        if 2 * filled > room:
                            return False
                between[place, AffinityColumn.SUM_ADJACENT + group] += value
                between[place, AffinityColumn.PAIRS_ADJACENT + group] += 1
    return True
