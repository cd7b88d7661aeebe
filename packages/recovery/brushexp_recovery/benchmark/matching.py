"""Which strokes that somebody found are which known ones.

A pair of a known and a found stroke matches where the regions in which they are seen have an intersection over union
above `MATCH_IOU`; each has one partner. Known strokes count that show 30 % of their area and 12 pixels
(`truth.Truth.counts`), found ones likewise; one that lies mostly on bare ground, or whose partner does not count, is
neither good nor bad.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from brushexp_recovery.benchmark.prediction import Prediction
from brushexp_recovery.benchmark.truth import VISIBLE_PIXELS, VISIBLE_SHARE, Truth
from brushexp_recovery.raster.labels import count_pixels
from brushexp_recovery.raster.overlap import Overlaps

Array = NDArray[Any]

BARE_SHARE = 0.5  # of a found stroke on bare ground, from which on it is not judged


@dataclass(frozen=True)
class Matches:
    """M pairs of known and found strokes, and which of the N found ones are judged."""

    truth: Array  # (M,) known strokes that count
    found: Array  # (M,) their partners
    iou: Array  # (M,) of their regions
    judged: Array  # (N,) whether a found stroke is good or bad


def match(truth: Truth, prediction: Prediction, overlaps: Overlaps, least_iou: float) -> Matches:
    """Pair strokes one to one, the best first, with at least the intersection over union ``least_iou``."""
    known_partner, found_partner = set[int](), set[int]()
    pairs = []
    for known, found, iou in sorted(zip(*overlaps, strict=True), key=lambda one: -one[2]):
        if iou >= least_iou and known not in known_partner and found not in found_partner:
            known_partner.add(known)
            found_partner.add(found)
            pairs.append((known, found, iou))
    knowns, founds, ious = np.array(pairs).reshape(-1, 3).T
    known, found = knowns.astype(int), founds.astype(int)
    counts = truth.counts[known]
    neutral, hit = np.zeros(len(prediction), bool), np.zeros(len(prediction), bool)
    neutral[found[~counts]] = True
    hit[found[counts]] = True
    judged = counting(prediction) & (hit | ~(neutral | on_ground(truth, prediction)))
    return Matches(known[counts], found[counts], ious[counts], judged)


def counting(prediction: Prediction) -> Array:
    """Tell which found strokes (N,) show enough of themselves to be judged."""
    visible: Array = count_pixels(prediction.labels, len(prediction))
    return (visible >= VISIBLE_SHARE * prediction.area) & (visible >= VISIBLE_PIXELS)


def on_ground(truth: Truth, prediction: Prediction) -> Array:
    """Tell which found strokes (N,) lie mostly where the truth has no stroke."""
    bare = count_pixels(np.where(truth.labels < 0, prediction.labels, -1), len(prediction))
    mostly: Array = bare > BARE_SHARE * count_pixels(prediction.labels, len(prediction))
    return mostly
