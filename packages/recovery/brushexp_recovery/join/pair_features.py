"""Compute the features of two neighbouring regions that a perceptron uses to predict whether they are one stroke."""
# mypy: allow-untyped-defs

from typing import Any

import numpy as np
from numpy.typing import NDArray

from brushexp.contracts.kernels import function, inline
from brushexp_recovery.join.shape import DESCRIPTION, Shape, describe
from brushexp_recovery.model.features import PairFeature
from brushexp_recovery.segment.moments import Moment
from brushexp_recovery.segment.region_adjacency import DISTANCE_GROUPS, AffinityColumn

Array = NDArray[Any]

BOUND = 20.0  # value that replaces infinite features
PRIOR_PAIRS = 0.5  # number of added pairs of affinity 0.5, which damp the mean of few pairs
LEAST_VISIBLE = 0.05  # lower bound of the visible share
LEAST_VARIANCE = 0.01  # lower bound of the variance of a colour in CIELAB
SCRATCH_ROWS = 4


def pair_features(moments: Array, pairs: Array, between: Array) -> Array:
    """Compute the float32 features (P, len(PairFeature)) of pairs (P, 2) of the N regions with the given moments.

    ``moments`` (N, len(Moment)) holds the summed moments of each region, and ``between`` (P, len(AffinityColumn)) the
    affinities between the two regions of each pair.
    """
    table = np.empty((len(pairs), len(PairFeature)), np.float32)
    _write_all(moments, pairs, between, table)
    return table


@function
def _write_all(moments, pairs, between, table):
    scratch = np.empty((SCRATCH_ROWS, DESCRIPTION))
    for number in range(len(pairs)):
        one, other = moments[pairs[number, 0]], moments[pairs[number, 1]]
        write_pair_features(one, other, between[number], scratch, table[number])


@function
def write_pair_features(one, other, between, scratch, row):
    """Write the features of a pair of regions to ``row`` (len(PairFeature),), given the moments of each.

    ``one`` and ``other`` (len(Moment),) are the moments; ``scratch`` (SCRATCH_ROWS, DESCRIPTION) is overwritten.
    """
    small, large, both, union = scratch[0], scratch[1], scratch[2], scratch[3]
    is_smaller = one[Moment.AREA] <= other[Moment.AREA]
    a, b = one if is_smaller else other, other if is_smaller else one
    for k in range(len(Moment)):
        union[k] = a[k] + b[k]
    describe(a, small)
    describe(b, large)
    describe(union, both)
    row[PairFeature.LOG_AREA_SMALL] = np.log(a[Moment.AREA])
    row[PairFeature.LOG_AREA_LARGE] = np.log(b[Moment.AREA])
    _write_affinities(between, a[Moment.AREA], row)
    _write_colors(small, large, row)
    _write_centres(small, large, both, row)
    _write_directions(small, large, both, row)
    _write_sizes(small, large, both, union[Moment.AREA], b[Moment.AREA], row)
    for k in range(len(PairFeature)):
        if np.isnan(row[k]):
            row[k] = 0
        elif np.isinf(row[k]):
            row[k] = np.copysign(np.float32(BOUND), row[k])


@inline
def _write_affinities(between, smaller_area, row):
    """Write the affinities between the pixels of the two regions to ``row``."""
    total, pairs = 0.0, 0.0
    for k in range(DISTANCE_GROUPS):
        affinity, number = between[AffinityColumn.SUM_ADJACENT + k], between[AffinityColumn.PAIRS_ADJACENT + k]
        total += affinity
        pairs += number
        row[PairFeature.AFFINITY_ADJACENT + k] = (affinity + 0.5 * PRIOR_PAIRS) / (number + PRIOR_PAIRS)
        row[PairFeature.LOG_PAIRS_ADJACENT + k] = np.log1p(number)
    row[PairFeature.AFFINITY] = (total + 0.5 * PRIOR_PAIRS) / (pairs + PRIOR_PAIRS)
    row[PairFeature.LOG_CONTACT] = np.log((between[AffinityColumn.PAIRS_ADJACENT] + 1) / np.sqrt(smaller_area))


@inline
def _write_colors(small, large, row):
    """Write the regions' colour difference in CIELAB, and the colour variation and paint share of each, to ``row``."""
    lightness = abs(small[Moment.LIGHTNESS] - large[Moment.LIGHTNESS])
    a, b = abs(small[Moment.A] - large[Moment.A]), abs(small[Moment.B] - large[Moment.B])
    row[PairFeature.LIGHTNESS_GAP] = lightness
    row[PairFeature.A_GAP] = a
    row[PairFeature.B_GAP] = b
    row[PairFeature.COLOR_GAP] = np.sqrt(lightness * lightness + a * a + b * b)
    row[PairFeature.COLOR_SPREAD_SMALL] = _color_spread(small)
    row[PairFeature.COLOR_SPREAD_LARGE] = _color_spread(large)
    row[PairFeature.PAINT_SMALL] = small[Moment.PAINT]
    row[PairFeature.PAINT_LARGE] = large[Moment.PAINT]


@inline
def _color_spread(one):
    """Compute the mean standard deviation of a region's colour in CIELAB."""
    lightness, a, b = one[Moment.LIGHTNESS], one[Moment.A], one[Moment.B]
    return (
        np.sqrt(max(one[Moment.LIGHTNESS_SQUARED] - lightness * lightness, LEAST_VARIANCE))
        + np.sqrt(max(one[Moment.A_SQUARED] - a * a, LEAST_VARIANCE))
        + np.sqrt(max(one[Moment.B_SQUARED] - b * b, LEAST_VARIANCE))
    ) / 3


@inline
def _write_centres(small, large, both, row):
    """Write the distances between the regions, and between the predicted centres of their strokes, to ``row``."""
    wide = np.exp(both[Moment.LOG_WIDTH])
    gap = np.hypot(small[Moment.CENTRE_X] - large[Moment.CENTRE_X], small[Moment.CENTRE_Y] - large[Moment.CENTRE_Y])
    distance = np.hypot(small[Moment.X] - large[Moment.X], small[Moment.Y] - large[Moment.Y])
    row[PairFeature.LOG_CENTRE_GAP] = np.log((gap + 1) / wide)
    row[PairFeature.CENTRE_GAP_BY_SPREAD] = gap / (small[Shape.SPREAD] + large[Shape.SPREAD])
    row[PairFeature.LOG_SPREAD_SMALL] = np.log(small[Shape.SPREAD] / wide)
    row[PairFeature.LOG_SPREAD_LARGE] = np.log(large[Shape.SPREAD] / wide)
    row[PairFeature.LOG_DISTANCE] = np.log(distance / wide + 1e-3)


@inline
def _write_directions(small, large, both, row):
    """Write measures of the agreement between the regions' predicted stroke directions to ``row``."""
    coherence_small = np.hypot(small[Moment.COSINE], small[Moment.SINE]) + 1e-3
    coherence_large = np.hypot(large[Moment.COSINE], large[Moment.SINE]) + 1e-3
    product = small[Moment.COSINE] * large[Moment.COSINE] + small[Moment.SINE] * large[Moment.SINE]
    row[PairFeature.COHERENCE_SMALL] = coherence_small
    row[PairFeature.COHERENCE_LARGE] = coherence_large
    row[PairFeature.DIRECTION_AGREEMENT] = product / (coherence_small * coherence_large)
    row[PairFeature.ALIGNMENT_BOTH] = both[Shape.ALIGNMENT]


@inline
def _write_sizes(small, large, both, area, larger_area, row):
    """Write the sizes of the regions and their union, relative to the predicted size of their stroke, to ``row``."""
    wide, long = np.exp(both[Moment.LOG_WIDTH]), np.exp(both[Moment.LOG_LENGTH])
    fill = np.log(area / (wide * long))
    row[PairFeature.LOG_PREDICTED_WIDTH] = both[Moment.LOG_WIDTH]
    row[PairFeature.WIDTH_GAP] = abs(small[Moment.LOG_WIDTH] - large[Moment.LOG_WIDTH])
    row[PairFeature.LENGTH_GAP] = abs(small[Moment.LOG_LENGTH] - large[Moment.LOG_LENGTH])
    row[PairFeature.LOG_FILL] = fill
    row[PairFeature.VISIBLE] = both[Moment.VISIBLE]
    row[PairFeature.LOG_FILL_BY_VISIBLE] = fill - np.log(max(both[Moment.VISIBLE], LEAST_VISIBLE))
    row[PairFeature.LOG_LENGTH_BOTH] = np.log(both[Shape.LENGTH] / long)
    row[PairFeature.LOG_WIDTH_BOTH] = np.log(both[Shape.WIDTH] / wide)
    row[PairFeature.LOG_LENGTH_SMALL] = np.log(small[Shape.LENGTH] / long)
    row[PairFeature.LOG_LENGTH_LARGE] = np.log(large[Shape.LENGTH] / long)
    row[PairFeature.LOG_WIDTH_SMALL] = np.log(small[Shape.WIDTH] / wide)
    row[PairFeature.LOG_WIDTH_LARGE] = np.log(large[Shape.WIDTH] / wide)
    row[PairFeature.LOG_LENGTH_GAIN] = np.log(both[Shape.LENGTH] / large[Shape.LENGTH])
    row[PairFeature.LOG_WIDTH_GAIN] = np.log(both[Shape.WIDTH] / large[Shape.WIDTH])
    row[PairFeature.LOG_COMPACTNESS_BOTH] = np.log(area / (both[Shape.LENGTH] * both[Shape.WIDTH]))
    row[PairFeature.LOG_COMPACTNESS_LARGE] = np.log(larger_area / (large[Shape.LENGTH] * large[Shape.WIDTH]))
