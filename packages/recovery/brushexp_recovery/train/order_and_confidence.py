"""The logistic models of order and of confidence learn from held-out paintings that nothing else has learned from."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from brushexp_recovery.confidence.features import confidence_features
from brushexp_recovery.curves.fit import fit_curves
from brushexp_recovery.find.look import SMALLEST_REGION
from brushexp_recovery.find.regions import find_regions
from brushexp_recovery.model.logistic import fit_logistic
from brushexp_recovery.model.recovery_model import RecoveryModel
from brushexp_recovery.order.evidence import find_meetings
from brushexp_recovery.raster.labels import count_pixels
from brushexp_recovery.raster.overlap import MATCH_IOU, overlaps_between
from brushexp_recovery.recover.pipeline import COPIES
from brushexp_recovery.synthesis.hand import Random
from brushexp_recovery.synthesis.paintings import Painted
from brushexp_recovery.train.parts import cut_part

Array = NDArray[Any]


class FoundRegions(NamedTuple):
    """N regions that were found in a painting, P meetings of them, and what is known of both."""

    confidence: Array  # (N, len(ConfidenceFeature))
    is_stroke: Array  # (N,)
    order: Array  # (P, len(OrderFeature)) of pairs that are strokes
    is_above: Array  # (P,) whether the second lies above
    strokes: int  # that there are


def fit_order_and_confidence(model: RecoveryModel, paintings: Sequence[Painted], seed: int) -> dict[str, float]:
    """Learn which of two regions lies above, and how likely regions are strokes; returns F1 and precision.

    They are found as `recover` finds them, in paintings clean and weathered.
    """
    random = np.random.default_rng(seed)
    found = [find_in(model, painted, is_weathered, random) for painted in paintings for is_weathered in (False, True)]
    is_stroke = np.concatenate([one.is_stroke for one in found])
    fit_logistic(model.confidence, np.concatenate([one.confidence for one in found]), is_stroke)
    is_above = np.concatenate([one.is_above for one in found])
    fit_logistic(model.order, np.concatenate([one.order for one in found]), is_above)
    f1 = 2 * is_stroke.sum() / max(len(is_stroke) + sum(one.strokes for one in found), 1)
    return {"f1": float(f1), "precision": float(is_stroke.sum() / max(len(is_stroke), 1))}


def find_in(model: RecoveryModel, painted: Painted, is_weathered: bool, random: Random) -> FoundRegions:
    """Find regions in a part of a painting, and compare them with its strokes."""
    part = cut_part(painted, is_weathered, random)
    regions = find_regions(model, part.image, None, COPIES, lambda *_: None)
    visible = count_pixels(part.labels, len(painted.geometry))
    overlaps = overlaps_between(part.labels, regions.labels, len(visible), len(regions.chance))
    matches = overlaps.iou >= MATCH_IOU
    stroke = np.full(len(regions.chance), -1)
    stroke[overlaps.second[matches]] = overlaps.first[matches]
    meetings = find_meetings(regions, fit_curves(regions, part.image))
    first, second = stroke[meetings.pairs].T
    known = (first >= 0) & (second >= 0) & (first != second)
    return FoundRegions(
        confidence=confidence_features(regions),
        is_stroke=stroke >= 0,
        order=meetings.features[known],
        is_above=(second > first)[known],
        strokes=int((visible >= SMALLEST_REGION).sum()),
    )
