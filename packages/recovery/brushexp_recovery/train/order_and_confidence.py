"""Fit the logistic models of order and confidence on held-out paintings that serve no other purpose."""

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
from brushexp_recovery.synthesis.paintings import KnownPainting
from brushexp_recovery.train.parts import cut_part

Array = NDArray[Any]


class LabelledRegions(NamedTuple):
    """N regions and P pairs of touching regions found in a painting, with the ground truth for both."""

    confidence: Array  # (N, len(ConfidenceFeature))
    is_stroke: Array  # (N,)
    order: Array  # (P, len(OrderFeature)), for pairs of strokes
    is_above: Array  # (P,) whether the second stroke lies above the first
    strokes: int  # number of strokes in the truth


def fit_order_and_confidence(model: RecoveryModel, paintings: Sequence[KnownPainting], seed: int) -> dict[str, float]:
    """Fit a model's order and confidence models on paintings, and return the F1 and precision of the regions found.

    Regions are found as `recover` finds them, in clean and weathered paintings.
    """
    random = np.random.default_rng(seed)
    looks = [(painting, is_weathered) for painting in paintings for is_weathered in (False, True)]
    results = [find_in(model, painting, is_weathered, random) for painting, is_weathered in looks]
    is_stroke = np.concatenate([one.is_stroke for one in results])
    fit_logistic(model.confidence, np.concatenate([one.confidence for one in results]), is_stroke)
    is_above = np.concatenate([one.is_above for one in results])
    fit_logistic(model.order, np.concatenate([one.order for one in results]), is_above)
    f1 = 2 * is_stroke.sum() / max(len(is_stroke) + sum(one.strokes for one in results), 1)
    return {"f1": float(f1), "precision": float(is_stroke.sum() / max(len(is_stroke), 1))}


def find_in(model: RecoveryModel, painting: KnownPainting, is_weathered: bool, random: Random) -> LabelledRegions:
    """Find regions in a part of a painting, and compare them with the painting's strokes."""
    part = cut_part(painting, is_weathered, random)
    regions = find_regions(model, part.image, None, COPIES, lambda *_: None)
    visible = count_pixels(part.labels, len(painting.geometry))
    overlaps = overlaps_between(part.labels, regions.labels, len(visible), len(regions.chance))
    matches = overlaps.iou >= MATCH_IOU
    stroke = np.full(len(regions.chance), -1)
    stroke[overlaps.second[matches]] = overlaps.first[matches]
    meetings = find_meetings(regions, fit_curves(regions, part.image))
    first, second = stroke[meetings.pairs].T
    known = (first >= 0) & (second >= 0) & (first != second)
    return LabelledRegions(
        confidence=confidence_features(regions),
        is_stroke=stroke >= 0,
        order=meetings.features[known],
        is_above=(second > first)[known],
        strokes=int((visible >= SMALLEST_REGION).sum()),
    )
