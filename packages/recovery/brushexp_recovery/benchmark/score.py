"""Score predicted strokes against the known strokes of a painting."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from brushexp_recovery.benchmark.matching import Matches, match
from brushexp_recovery.benchmark.neighbourhood import field_errors
from brushexp_recovery.benchmark.prediction import Prediction
from brushexp_recovery.benchmark.truth import Truth
from brushexp_recovery.confidence.calibration import calibration_of
from brushexp_recovery.curves.bezier import arc_lengths, chords_of
from brushexp_recovery.raster.overlap import MATCH_IOU, overlaps_between

Array = NDArray[Any]

SOFT_IOU = 0.3  # minimum intersection over union for a soft match
ELONGATED = 1.5  # minimum length, in widths, of a stroke with a direction
VISIBLE_SHARES = {"little": (0.3, 0.6), "most": (0.6, 0.9), "whole": (0.9, np.inf)}


def score(truth: Truth, prediction: Prediction) -> dict[str, Any]:
    """Compute all scores of a prediction; undefined scores are NaN.

    Keys: ``f1``, ``recall``, ``precision`` (and ``_soft``, at `SOFT_IOU`), ``best_iou``, ``split`` and ``joined``;
    ``recall_little``, ``_most`` and ``_whole`` by visible fraction; over matched strokes, the medians
    ``direction_deg``, ``length_rel``, ``width_rel``, ``width_bias`` and ``color_de00`` (CIEDE2000) and the mean
    ``iou``; ``order_agreement``, ``order_tau`` and ``order_pairs``; neighbourhood errors ``field_...``; and, for
    predictions with confidences, ``auc``, ``ece`` and ``reliability``.
    """
    overlaps = overlaps_between(truth.labels, prediction.labels, len(truth), len(prediction))
    soft, matches = (match(truth, prediction, overlaps, least) for least in (SOFT_IOU, MATCH_IOU))
    figures: dict[str, Any] = {"truth": int(truth.counts.sum()), "predicted": int(prediction.counts.sum())}
    figures |= {f"{name}_soft": value for name, value in rates_of(truth, prediction, soft).items()}
    figures |= rates_of(truth, prediction, matches)
    figures |= {f"recall_{name}": value for name, value in recall_by_share(truth, matches).items()}
    best = np.zeros(len(truth))
    np.maximum.at(best, overlaps.first, overlaps.iou)
    figures["best_iou"] = mean_of(best[truth.counts])
    figures["split"] = parts_of(truth.labels, prediction.labels, truth.counts)
    figures["joined"] = parts_of(prediction.labels, truth.labels, prediction.counts)
    figures |= errors_of(truth, prediction, matches) | order_of(truth, prediction, matches)
    figures |= field_errors(truth, prediction, truth.counts, matches.judged & prediction.counts)
    if prediction.confidence is not None:
        hit = np.isin(np.arange(len(prediction)), matches.prediction)
        figures |= calibration_of(prediction.confidence[matches.judged], hit[matches.judged])
    return figures


def rates_of(truth: Truth, prediction: Prediction, matches: Matches) -> dict[str, float]:
    """Compute recall, precision and F1."""
    recall = len(matches.truth) / max(int(truth.counts.sum()), 1)
    precision = int(prediction.counts[matches.prediction].sum()) / max(int(matches.judged.sum()), 1)
    total = recall + precision
    return {"recall": recall, "precision": precision, "f1": 2 * recall * precision / total if total else 0.0}


def recall_by_share(truth: Truth, matches: Matches) -> dict[str, float]:
    """Compute the recall of known strokes, grouped by their visible fraction."""
    is_matched = np.isin(np.arange(len(truth)), matches.truth)
    groups = {
        name: truth.counts & (truth.share >= low) & (truth.share < high) for name, (low, high) in VISIBLE_SHARES.items()
    }
    return {name: mean_of(is_matched[group]) for name, group in groups.items()}


def parts_of(a: Array, b: Array, chosen: Array) -> float:
    """Compute the median number of regions of ``b`` into which the chosen regions of ``a`` are split.

    A region's number is 1 / (sum of its parts' squared fractions), so small parts contribute little.
    """
    inside = a >= 0
    most = int(b.max(initial=-1)) + 2
    pair, shared = np.unique(a[inside].astype(np.int64) * most + b[inside] + 1, return_counts=True)
    total, squares = (np.bincount(pair // most, weight, len(chosen)) for weight in (shared, shared**2.0))
    return median_of((total**2 / np.maximum(squares, 1))[chosen])


def errors_of(truth: Truth, prediction: Prediction, matches: Matches) -> dict[str, float]:
    """Compute the median errors of matched strokes and their mean intersection over union."""
    from skimage.color import deltaE_ciede2000, rgb2lab  # noqa: PLC0415

    known, partner = matches.truth, matches.prediction
    width, other_width = truth.width[known], prediction.width[partner]
    length = arc_lengths(truth.curve[known]) + width
    other_length = arc_lengths(prediction.curve[partner]) + other_width
    turn = angle_between(angles_of(truth.curve[known]), angles_of(prediction.curve[partner]))
    lab, other_lab = (rgb2lab(color[None].clip(0, 1)) for color in (truth.seen[known], prediction.color[partner]))
    return {
        "direction_deg": median_of(turn[length > ELONGATED * width]),
        "length_rel": median_of(np.abs(other_length / length - 1)),
        "width_rel": median_of(np.abs(other_width / width - 1)),
        "width_bias": median_of(other_width / width - 1),
        "color_de00": median_of(deltaE_ciede2000(lab, other_lab)[0]),
        "iou": mean_of(matches.iou),
    }


def order_of(truth: Truth, prediction: Prediction, matches: Matches) -> dict[str, float]:
    """Compute the fraction of overlapping matched pairs in the correct order, and Kendall's tau, from -1 to 1."""
    if not prediction.ordered:
        return {"order_tau": float("nan"), "order_agreement": float("nan"), "order_pairs": 0}
    rank = np.full(len(truth), -1)
    rank[matches.truth] = matches.prediction
    lower, upper = truth.pairs[(rank[truth.pairs] >= 0).all(1)].T
    right = rank[upper] > rank[lower]
    return {"order_tau": mean_of(2.0 * right - 1), "order_agreement": mean_of(right), "order_pairs": len(lower)}


def angles_of(curve: Array) -> Array:
    """Return the directions (N,), in radians, of the chords of curves (N, 3, 2)."""
    x, y = chords_of(curve).T
    return np.arctan2(y, x)


def angle_between(a: Array, b: Array) -> Array:
    """Return the angles in degrees, 0 to 90, between directions in radians."""
    return np.degrees(np.abs((a - b + np.pi / 2) % np.pi - np.pi / 2))


def median_of(values: Array) -> float:
    """Return the median, or NaN if there are no values."""
    return float(np.median(values)) if len(values) else float("nan")


def mean_of(values: Array) -> float:
    """Return the mean, or NaN if there are no values."""
    return float(np.mean(values)) if len(values) else float("nan")
