"""Match predicted strokes with known strokes.

A known and a predicted stroke match if the intersection over union of their visible regions is at least `MATCH_IOU`;
each stroke has at most one partner. A stroke, known or predicted, is scored if at least 30 % of its area and 12 pixels
are visible (`Truth.counts`). A predicted stroke that is mostly on bare ground, or whose partner is not scored, is
considered neither correct nor wrong.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from brushexp_recovery.benchmark.prediction import Prediction
from brushexp_recovery.benchmark.truth import Truth
from brushexp_recovery.raster.labels import count_pixels
from brushexp_recovery.raster.overlap import Overlaps, pair_best

Array = NDArray[Any]

BARE_SHARE = 0.5  # share of a predicted stroke on bare ground, above which it is not judged


@dataclass(frozen=True)
class Matches:
    """M matching pairs of known and predicted strokes, and a mask of the N predicted strokes that are scored."""

    truth: Array  # (M,) known strokes that count
    prediction: Array  # (M,) their partners
    iou: Array  # (M,) intersection over union of their regions
    judged: Array  # (N,) whether a predicted stroke is right or wrong, not neutral


def match(truth: Truth, prediction: Prediction, overlaps: Overlaps, least_iou: float) -> Matches:
    """Pair strokes one to one, best pairs first, if their intersection over union is at least ``least_iou``."""
    known, partner, ious = pair_best(overlaps, least_iou)
    counts = truth.counts[known]
    neutral, hit = np.zeros(len(prediction), bool), np.zeros(len(prediction), bool)
    neutral[partner[~counts]] = True
    hit[partner[counts]] = True
    judged = prediction.counts & (hit | ~(neutral | on_ground(truth, prediction)))
    return Matches(known[counts], partner[counts], ious[counts], judged)


def on_ground(truth: Truth, prediction: Prediction) -> Array:
    """Mark the predicted strokes (N,) that are mostly on ground where there is no known stroke."""
    bare = count_pixels(np.where(truth.labels < 0, prediction.labels, -1), len(prediction))
    mostly: Array = bare > BARE_SHARE * count_pixels(prediction.labels, len(prediction))
    return mostly
