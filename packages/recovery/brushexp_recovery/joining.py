"""Regions are joined one pair after another, the likeliest first: the loop behind `tree.grow`."""
# mypy: allow-untyped-defs

from heapq import heapify, heappop, heappush

import numpy as np

from brushexp.compat.compiled import function, inline
from brushexp_recovery.judges import CLIPPED
from brushexp_recovery.merging import DESCRIBED, PAIR_FEATURES, describe_pair
from brushexp_recovery.regions import GROUPS

LARGEST = 8.0  # times the size of a stroke there, beyond which a region is joined no further


@function
def mean_affinity(row, mean, scale, layers, space):
    """Return the mean affinity between two regions by their features, the nearest pixels counting most."""
    total, count = 0.0, 1e-9
    for k in range(GROUPS):
        number = max(4 >> k, 1) * np.expm1(row[GROUPS + k])
        total += row[k] * number
        count += number
    return total / count


@function
def judged(row, mean, scale, layers, space):
    """Return what a judge says of features (F,): see `Judge.forward`; ``space`` (2, widest layer) is for a while."""
    here, there = space[0], space[1]
    for k in range(len(row)):
        here[k] = min(max((row[k] - mean[k]) / scale[k], -CLIPPED), CLIPPED)
    for number in range(len(layers)):
        layer = layers[number]
        before, after = layer.shape[0] - 1, layer.shape[1]
        for j in range(after):
            there[j] = layer[before, j]
        for k in range(before):
            value = here[k] if number == 0 else max(here[k], np.float32(0))
            for j in range(after):
                there[j] += value * layer[k, j]
        here, there = there, here
    return 1 / (1 + np.exp(-here[0]))


@function
def join(sums, within, around, made, urge, ends, between, least, children, mean, scale, layers):
    """Join pairs of regions until none has a chance of ``least``; returns how many joins there were.

    The first S rows of ``sums`` (2 S, SUMS), ``within``, ``around``, ``made`` and ``urge`` are of the S regions; those
    of what they are joined to follow, and all but those of sums and within are written here. ``ends`` (P, 2) are the
    pairs at first and ``between`` (P, 8) their affinities; both are used up. ``children`` (S, 2) are the two nodes of
    each join. The pairs of a region are linked: ``first`` of a region, then ``after`` of a pair at either end.
    """
    count = len(sums) // 2
    first, after = np.full(2 * count, -1), np.full(ends.shape, -1)
    pair_with, seen_by = np.full(2 * count, -1), np.full(2 * count, -1)  # the pair of a region with a new one
    open_pairs, gone = np.ones(len(ends), np.bool_), np.zeros(2 * count, np.bool_)
    row, space, places = np.empty(PAIR_FEATURES, np.float32), _space(layers), np.empty((4, DESCRIBED))
    heap = [(0.0, 0, 0, 0) for _ in range(0)]
    for pair in range(len(ends)):
        describe_pair(sums[ends[pair, 0]], sums[ends[pair, 1]], between[pair], places, row)
        value = float(ask(row, mean, scale, layers, space))
        if value > least:
            heap.append((-value, ends[pair, 0], ends[pair, 1], pair))
        for side in range(2):
            region = ends[pair, side]
            after[pair, side], first[region] = first[region], pair
            urge[region] = max(urge[region], value)
            around[region] += between[pair]
    heapify(heap)
    new = count
    while heap:
        chance, i, j, joined = heappop(heap)
        if gone[i] or gone[j]:
            continue
        gone[i] = gone[j] = True
        open_pairs[joined] = False
        children[new - count, 0], children[new - count, 1] = i, j
        made[new] = -chance
        sums[new] = sums[i] + sums[j]
        within[new] = within[i] + within[j] + between[joined]
        around[new] = around[i] + around[j] - 2 * between[joined]
        for old in (i, j):
            _hand_over(old, new, first, after, ends, between, open_pairs, pair_with, seen_by)
        stroke = np.exp((sums[new, 17] + sums[new, 18]) / sums[new, 0])
        too_large = sums[new, 0] > LARGEST * stroke  # it would touch half a picture
        pair = first[new]
        while pair >= 0:
            side = 0 if ends[pair, 0] == new else 1
            other = ends[pair, 1 - side]
            if too_large:
                open_pairs[pair] = False
            else:
                describe_pair(sums[new], sums[other], between[pair], places, row)
                value = float(ask(row, mean, scale, layers, space))
                urge[new] = max(urge[new], value)
                if value > least:
                    heappush(heap, (-value, new, other, pair))
            pair = after[pair, side]
        new += 1
    return new - count


@inline
def _hand_over(old, new, first, after, ends, between, open_pairs, pair_with, seen_by):
    """Give the open pairs of a region to the new one that it is now part of; two with one neighbour become one."""
    pair = first[old]
    while pair >= 0:
        side = 0 if ends[pair, 0] == old else 1
        following, other = after[pair, side], ends[pair, 1 - side]
        if open_pairs[pair] and seen_by[other] == new:
            open_pairs[pair] = False
            between[pair_with[other]] += between[pair]
        elif open_pairs[pair]:
            pair_with[other], seen_by[other] = pair, new
            ends[pair, side] = new
            after[pair, side] = first[new]
            first[new] = pair
        pair = following


@inline
def _space(layers):
    """Make room for the layers of a judge."""
    widest = PAIR_FEATURES
    for number in range(len(layers)):
        widest = max(widest, layers[number].shape[1])
    return np.empty((2, widest), np.float32)


ask = judged
join_by_affinity = join.having(ask=mean_affinity)
