"""Two neighbouring regions are described, so that a judge can say whether they are one stroke."""
# mypy: allow-untyped-defs

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from brushexp.compat.compiled import function, inline
from brushexp_recovery.regions import GROUPS, SUMS

Array = NDArray[Any]

FARTHEST = 20.0  # that a feature may be from 0
PAIR_FEATURES = 45
LENGTH, WIDTH, SPREAD, ALONG, DESCRIBED = range(SUMS, SUMS + 5)  # columns of `described` after the means


class Described(NamedTuple):
    """Means and shapes of N regions."""

    mean: Array  # (N, SUMS)
    length: Array  # (N,) pixels, of the rectangle with the same moments
    width: Array  # (N,)
    spread: Array  # (N,) pixels by which opinions of the centre differ
    along: Array  # (N,) agreement of the direction with what the network says of it, -1 to 1


def describe(sums: Array) -> Described:
    """Describe regions by their sums (N, SUMS)."""
    table = np.empty((len(sums), DESCRIBED))
    _describe_all(sums, table)
    return Described(table[:, :SUMS], *(table[:, k] for k in (LENGTH, WIDTH, SPREAD, ALONG)))


@function
def _describe_all(sums, table):
    for number in range(len(sums)):
        described(sums[number], table[number])


@function
def described(sums, out):
    """Write the means and the shape (`DESCRIBED`,) of a region by its sums (SUMS,)."""
    for k in range(SUMS):
        out[k] = sums[k] / sums[0]
    xx = out[3] - out[1] * out[1] + 1 / 12
    yy = out[5] - out[2] * out[2] + 1 / 12
    xy = out[4] - out[1] * out[2]
    half = np.hypot(0.5 * (xx - yy), xy)
    out[LENGTH] = np.sqrt(12 * (0.5 * (xx + yy) + half))
    out[WIDTH] = np.sqrt(12 * max(0.5 * (xx + yy) - half, 0.05))
    out[SPREAD] = np.sqrt(max(out[14] - out[12] * out[12] - out[13] * out[13], 0.01))
    norms = (2 * half + 1e-3) * (np.hypot(out[15], out[16]) + 1e-3)
    out[ALONG] = ((xx - yy) * out[15] + 2 * xy * out[16]) / norms


def pair_features(sums: Array, pairs: Array, between: Array) -> Array:
    """Describe pairs (P, 2) of regions, with the affinities (P, 8) between them: (P, F) float32."""
    table = np.empty((len(pairs), PAIR_FEATURES), np.float32)
    _describe_pairs(sums, pairs, between, table)
    return table


@function
def _describe_pairs(sums, pairs, between, table):
    space = np.empty((4, DESCRIBED))
    for number in range(len(pairs)):
        describe_pair(sums[pairs[number, 0]], sums[pairs[number, 1]], between[number], space, table[number])


@function
def describe_pair(one, other, between, space, row):
    """Write the features (`PAIR_FEATURES`,) of two regions by their sums; ``space`` (4, `DESCRIBED`) is for a while."""
    swap = one[0] > other[0]
    a, b = other if swap else one, one if swap else other  # the smaller and the larger one
    small, large, both, sums = space[0], space[1], space[2], space[3]
    for k in range(SUMS):
        sums[k] = a[k] + b[k]
    described(a, small)
    described(b, large)
    described(sums, both)
    total, count = 0.0, 0.0
    for k in range(GROUPS):
        total += between[k]
        count += between[GROUPS + k]
        row[k] = (between[k] + 0.25) / (between[GROUPS + k] + 0.5)
        row[GROUPS + k] = np.log1p(between[GROUPS + k])
    wide, long = np.exp(both[17]), np.exp(both[18])
    filled = np.log(sums[0] / (wide * long))
    light, red, yellow = abs(small[6] - large[6]), abs(small[7] - large[7]), abs(small[8] - large[8])
    turn, turn_large = np.hypot(small[15], small[16]) + 1e-3, np.hypot(large[15], large[16]) + 1e-3
    agree = (small[15] * large[15] + small[16] * large[16]) / (turn * turn_large)
    gap = np.hypot(small[12] - large[12], small[13] - large[13])
    apart = np.hypot(small[1] - large[1], small[2] - large[2])
    values = (
        (total + 0.25) / (count + 0.5), np.log(a[0]), np.log(b[0]), light, red, yellow,
        np.sqrt(light * light + red * red + yellow * yellow), _grain(small), _grain(large),
        np.log((gap + 1) / wide), gap / (small[SPREAD] + large[SPREAD]), np.log(small[SPREAD] / wide),
        np.log(large[SPREAD] / wide), turn, turn_large, agree, both[ALONG], abs(small[17] - large[17]),
        abs(small[18] - large[18]), filled, both[19], filled - np.log(max(both[19], 0.05)),
        np.log(both[LENGTH] / long), np.log(both[WIDTH] / wide), np.log(small[LENGTH] / long),
        np.log(large[LENGTH] / long), np.log(small[WIDTH] / wide), np.log(large[WIDTH] / wide),
        np.log(both[LENGTH] / large[LENGTH]), np.log(both[WIDTH] / large[WIDTH]),
        np.log(sums[0] / (both[LENGTH] * both[WIDTH])), np.log(b[0] / (large[LENGTH] * large[WIDTH])),
        np.log(apart / wide + 1e-3), np.log((between[GROUPS] + 1) / np.sqrt(a[0])), small[20], large[20], both[17],
    )  # fmt: skip
    for k in range(len(values)):
        value = values[k]
        value = 0.0 if np.isnan(value) else np.copysign(FARTHEST, value) if np.isinf(value) else value
        row[2 * GROUPS + k] = value


@inline
def _grain(one):
    """Measure how much the colour of a region varies, in CIELAB."""
    return (
        np.sqrt(max(one[9] - one[6] * one[6], 0.01))
        + np.sqrt(max(one[10] - one[7] * one[7], 0.01))
        + np.sqrt(max(one[11] - one[8] * one[8], 0.01))
    ) / 3


def bounded(columns: list[Array]) -> Array:
    """Put features together, (N, F) float32 without infinities."""
    table = np.nan_to_num(np.stack(columns, 1), nan=0.0, posinf=FARTHEST, neginf=-FARTHEST)
    return table.astype(np.float32)
