"""Compute the evidence for which of two touching strokes is above the other."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from brushexp_recovery.curves.coverage import cover_strokes
from brushexp_recovery.curves.fit import StrokeCurves
from brushexp_recovery.find.regions import OCCLUSION_STEPS, Regions
from brushexp_recovery.model.channels import LOG_SIZE, OCCLUSION_OFFSETS, StrokeAttribute
from brushexp_recovery.model.features import OrderFeature
from brushexp_recovery.raster.labels import count_pixels
from brushexp_recovery.raster.offsets import pair_slices

Array = NDArray[Any]

PRIOR_PIXELS = 4  # number of added pixels of neither stroke, which damp the share of few pixels


class Meetings(NamedTuple):
    """Pairs of regions that touch."""

    pairs: Array  # (P, 2), lower number first
    features: Array  # (P, len(OrderFeature)) evidence that the second lies above the first


class Contacts(NamedTuple):
    """Pairs of pixels in different regions, separated by the `OCCLUSION_OFFSETS`."""

    pairs: Array  # (P, 2) regions that meet, lower number first
    pair: Array  # (M,) the pair of each contact
    log_odds: Array  # (M,) predicted log-odds that the second region of the pair lies above the first


def find_meetings(regions: Regions, strokes: StrokeCurves) -> Meetings:
    """Find the pairs of regions that touch, and the evidence that the second region is above the first.

    The evidence consists of the network's predictions where the regions meet; the difference in how much of each
    stroke is visible; which region owns the pixels where the complete strokes would overlap, because an unbroken
    outline belongs to the upper stroke (Kanizsa, 1979); and the differences in width, area and confidence, because
    painters proceed from broad to fine strokes.
    """
    contacts = find_contacts(regions)
    pairs, count = contacts.pairs, len(contacts.pairs)
    number = np.bincount(contacts.pair, minlength=count)
    mean = np.bincount(contacts.pair, contacts.log_odds, count) / np.maximum(number, 1)
    votes = np.bincount(contacts.pair, np.tanh(contacts.log_odds / 2), count) / np.maximum(number, 1)
    crossing, pixels = _compare_crossings(regions.labels, pairs, strokes)
    log_area = np.log(np.maximum(count_pixels(regions.labels, len(regions.chance)), 1))
    attributes = regions.attributes
    of_region = {
        OrderFeature.VISIBLE: attributes[:, StrokeAttribute.VISIBLE],
        OrderFeature.LOG_FILL: log_area - attributes[:, LOG_SIZE].sum(1),
        OrderFeature.LOG_WIDTH: attributes[:, StrokeAttribute.LOG_WIDTH],
        OrderFeature.LOG_AREA: log_area,
        OrderFeature.CHANCE: regions.chance,
    }
    features = np.empty((count, len(OrderFeature)))
    features[:, OrderFeature.OCCLUSION] = mean * np.sqrt(number)
    features[:, OrderFeature.OCCLUSION_VOTES] = votes
    features[:, OrderFeature.CROSSING] = crossing
    features[:, OrderFeature.CROSSING_PIXELS] = crossing * np.sqrt(pixels)
    first, second = pairs.T
    for feature, value in of_region.items():
        features[:, feature] = value[second] - value[first]
    return Meetings(pairs, features)


def find_contacts(regions: Regions) -> Contacts:
    """Find the pairs of regions that touch, and the predicted occlusion at each contact."""
    labels, count = regions.labels, len(regions.chance)
    keys, values = [np.empty(0, np.int64)], [np.empty(0)]
    for channel, offset in enumerate(OCCLUSION_OFFSETS):
        dy, dx = (round(step / regions.zoom) or int(np.sign(step)) for step in offset)
        here, there = pair_slices(labels.shape, (dy, dx))
        differ = (labels[here] != labels[there]) & (labels[here] >= 0) & (labels[there] >= 0)
        a, b = labels[here][differ].astype(np.int64), labels[there][differ]
        value = regions.occlusion[channel][here][differ] / OCCLUSION_STEPS
        keys.append(np.minimum(a, b) * count + np.maximum(a, b))
        values.append(np.where(a < b, value, -value))
    key, pair = np.unique(np.concatenate(keys), return_inverse=True)
    return Contacts(np.stack([key // max(count, 1), key % max(count, 1)], 1), pair, np.concatenate(values))


def _compare_crossings(labels: Array, pairs: Array, strokes: StrokeCurves) -> tuple[Array, Array]:
    """Compare, for each pair of strokes (P,), how many pixels each owns where the complete strokes overlap.

    Returns:
        The fraction of the pixels that the second stroke owns minus the fraction that the first owns (P,), -1 to 1, and
        the number of pixels that either stroke owns (P,).
    """
    covers = cover_strokes(strokes.curve, strokes.width, (labels.shape[0], labels.shape[1]))
    difference, pixels = np.zeros(len(pairs)), np.zeros(len(pairs))
    for number, (first, second) in enumerate(pairs.tolist()):
        one, two = covers[first], covers[second]
        box = one.box.intersection(two.box)
        if box.is_empty:
            continue
        crossing = one.mask[box.within(one.box).slices] & two.mask[box.within(two.box).slices]
        visible = labels[box.slices][crossing]
        above, below = (visible == second).sum(), (visible == first).sum()
        difference[number] = (above - below) / (above + below + PRIOR_PIXELS)
        pixels[number] = above + below
    return difference, pixels
