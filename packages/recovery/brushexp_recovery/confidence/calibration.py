"""Measure how well confidences are calibrated: 80 % of the strokes with a confidence of 0.8 should be correct."""

from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]

BINS = 10  # number of bins of equal width


class ReliabilityBin(NamedTuple):
    """A bin of strokes with similar confidence."""

    confidence: float  # mean confidence
    right: float  # share of correct strokes
    strokes: int


def calibration_of(confidence: Array, hit: Array) -> dict[str, Any]:
    """Compare confidences (N,) in [0, 1] with the correctness (N,) of the strokes.

    Returns:
        ``auc``, the probability that a correct stroke has higher confidence than an incorrect one (NaN if there are no
        correct or no incorrect strokes); ``ece``, the expected calibration error; ``reliability``, a `ReliabilityBin`
        for each bin that contains strokes.
    """
    place = np.minimum((confidence * BINS).astype(int), BINS - 1)
    reliability = [
        ReliabilityBin(
            float(confidence[place == number].mean()),
            float(hit[place == number].mean()),
            int((place == number).sum()),
        )
        for number in range(BINS)
        if (place == number).any()
    ]
    auc = auc_of(confidence[hit], confidence[~hit])
    return {"auc": auc, "ece": ece_of(reliability), "reliability": reliability}


def ece_of(reliability: Sequence[ReliabilityBin]) -> float:
    """Compute the expected calibration error (Naeini et al., 2015), or NaN if there are no strokes.

    With few strokes the error is large even if the confidence is well calibrated, so pool the reliability of several
    paintings first.
    """
    total = sum(one.strokes for one in reliability)
    gap = sum(one.strokes * abs(one.confidence - one.right) for one in reliability)
    return gap / total if total else float("nan")


def auc_of(right: Array, wrong: Array) -> float:
    """Compute the area under the ROC curve from ranks (Mann and Whitney, 1947); ties count half."""
    if not len(right) or not len(wrong):
        return float("nan")
    below = np.searchsorted(np.sort(wrong), right, "left") + np.searchsorted(np.sort(wrong), right, "right")
    return float(below.sum() / (2 * len(right) * len(wrong)))


def join_reliability(paintings: Iterable[Sequence[ReliabilityBin]]) -> list[ReliabilityBin]:
    """Pool the reliability of several paintings, bin by bin."""
    groups: dict[int, list[ReliabilityBin]] = {}
    for one in (one for painting in paintings for one in painting):
        groups.setdefault(min(int(one.confidence * BINS), BINS - 1), []).append(one)
    joined = []
    for _, group in sorted(groups.items()):
        strokes = sum(one.strokes for one in group)
        confidence = sum(one.confidence * one.strokes for one in group) / strokes
        right = sum(one.right * one.strokes for one in group) / strokes
        joined.append(ReliabilityBin(confidence, right, strokes))
    return joined
