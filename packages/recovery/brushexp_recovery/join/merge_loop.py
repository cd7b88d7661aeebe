"""The loop of `merge_tree.grow_tree`, which merges pairs of regions one by one, most probable pair first."""
# mypy: allow-untyped-defs

from heapq import heapify, heappop, heappush

import numpy as np

from brushexp.contracts.kernels import function, inline
from brushexp_recovery.join.pair_features import SCRATCH_ROWS, write_pair_features
from brushexp_recovery.join.shape import DESCRIPTION
from brushexp_recovery.model.features import PairFeature
from brushexp_recovery.model.perceptron import CLIP
from brushexp_recovery.segment.moments import Moment
from brushexp_recovery.segment.region_adjacency import DISTANCE_GROUPS

LARGEST_REGION = 8.0  # area, in predicted areas of its stroke, above which a region is not merged further


@function
def mean_affinity(row, mean, scale, layers, scratch):
    """Compute the mean affinity between two regions from their features, with the most weight on adjacent pixels."""
    total, count = 0.0, 1e-9
    for k in range(DISTANCE_GROUPS):
        pairs = max(4 >> k, 1) * np.expm1(row[PairFeature.LOG_PAIRS_ADJACENT + k])
        total += row[PairFeature.AFFINITY_ADJACENT + k] * pairs
        count += pairs
    return total / count


@function
def perceptron_chance(row, mean, scale, layers, scratch):
    """Return the probability that a perceptron predicts from features (F,), as `PerceptronWeights` does.

    ``scratch`` (2, widest layer) is overwritten.
    """
    inputs, outputs = scratch[0], scratch[1]
    for k in range(len(row)):
        inputs[k] = min(max((row[k] - mean[k]) / scale[k], -CLIP), CLIP)
    for number in range(len(layers)):
        layer = layers[number]
        before, after = layer.shape[0] - 1, layer.shape[1]
        for j in range(after):
            outputs[j] = layer[before, j]
        for k in range(before):
            value = inputs[k] if number == 0 else max(inputs[k], np.float32(0))
            for j in range(after):
                outputs[j] += value * layer[k, j]
        inputs, outputs = outputs, inputs
    return 1 / (1 + np.exp(-inputs[0]))


@function
def merge(
    moments, within, around, merge_chance, neighbour_chance, ends, between, children, least_chance, mean, scale, layers
):
    """Merge pairs of regions until no pair has a probability above ``least_chance``; return the number of merges.

    Rows 0 to S - 1 of ``moments`` (2 S, len(Moment)), ``within``, ``around``, ``merge_chance`` and ``neighbour_chance``
    belong to the S initial regions, and later rows to merged regions. The first S rows of ``moments`` and ``within``
    are inputs; everything else is written. ``ends`` (P, 2) are the initial pairs and ``between``
    (P, len(AffinityColumn)) their affinities; both are overwritten. The two regions of each merge are written into
    ``children`` (S, 2).
    """
    count = len(moments) // 2
    first, after = _link_pairs(ends, 2 * count)
    is_open = np.ones(len(ends), np.bool_)
    pair_with, seen_by = np.full(2 * count, -1), np.full(2 * count, -1)  # the pair of each region with the new region
    gone = np.zeros(2 * count, np.bool_)
    row, scratch = np.empty(len(PairFeature), np.float32), np.empty((SCRATCH_ROWS, DESCRIPTION))
    layer_scratch = _layer_scratch(layers)
    heap = [(0.0, 0, 0, 0) for _ in range(0)]
    for pair in range(len(ends)):
        write_pair_features(moments[ends[pair, 0]], moments[ends[pair, 1]], between[pair], scratch, row)
        value = float(chance(row, mean, scale, layers, layer_scratch))
        if value > least_chance:
            heap.append((-value, ends[pair, 0], ends[pair, 1], pair))
        for region in ends[pair]:
            neighbour_chance[region] = max(neighbour_chance[region], value)
            around[region] += between[pair]
    heapify(heap)
    new = count
    while heap:
        negative_chance, i, j, merged = heappop(heap)
        if gone[i] or gone[j]:
            continue
        gone[i] = gone[j] = True
        is_open[merged] = False
        children[new - count, 0], children[new - count, 1] = i, j
        merge_chance[new] = -negative_chance
        moments[new] = moments[i] + moments[j]
        within[new] = within[i] + within[j] + between[merged]
        around[new] = around[i] + around[j] - 2 * between[merged]
        for old in (i, j):
            _pass_on_pairs(old, new, first, after, ends, between, is_open, pair_with, seen_by)
        too_large = _is_too_large(moments[new])
        pair = first[new]
        while pair >= 0:
            side = 0 if ends[pair, 0] == new else 1
            other = ends[pair, 1 - side]
            if too_large:
                is_open[pair] = False
            else:
                write_pair_features(moments[new], moments[other], between[pair], scratch, row)
                value = float(chance(row, mean, scale, layers, layer_scratch))
                neighbour_chance[new] = max(neighbour_chance[new], value)
                if value > least_chance:
                    heappush(heap, (-value, new, other, pair))
            pair = after[pair, side]
        new += 1
    return new - count


@function
def _link_pairs(ends, count):
    """Build a linked list of each region's pairs (P, 2); return each list's first pair, and all successors."""
    first, after = np.full(count, -1), np.full(ends.shape, -1)
    for pair in range(len(ends)):
        for side in range(2):
            region = ends[pair, side]
            after[pair, side], first[region] = first[region], pair
    return first, after


@inline
def _pass_on_pairs(old, new, first, after, ends, between, is_open, pair_with, seen_by):
    """Transfer a region's open pairs to the merged region that contains it; combine pairs with the same neighbour."""
    pair = first[old]
    while pair >= 0:
        side = 0 if ends[pair, 0] == old else 1
        following, other = after[pair, side], ends[pair, 1 - side]
        if is_open[pair] and seen_by[other] == new:
            is_open[pair] = False
            between[pair_with[other]] += between[pair]
        elif is_open[pair]:
            pair_with[other], seen_by[other] = pair, new
            ends[pair, side] = new
            after[pair, side] = first[new]
            first[new] = pair
        pair = following


@inline
def _layer_scratch(layers):
    """Allocate scratch space for the layers of a perceptron."""
    widest = len(PairFeature)
    for number in range(len(layers)):
        widest = max(widest, layers[number].shape[1])
    return np.empty((2, widest), np.float32)


@inline
def _is_too_large(moments):
    """Check whether a region is so large, compared with its predicted stroke, that it should not grow further."""
    stroke_area = np.exp((moments[Moment.LOG_WIDTH] + moments[Moment.LOG_LENGTH]) / moments[Moment.AREA])
    return moments[Moment.AREA] > LARGEST_REGION * stroke_area


chance = perceptron_chance  # computes in `merge` the probability that two regions are one stroke
merge_by_affinity = merge.with_parts(chance=mean_affinity)
