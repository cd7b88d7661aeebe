"""How far a confidence can be trusted: of strokes found with 0.8, 80 % should be right."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from brushexp_recovery.finding import Regions

Array = NDArray[Any]

BINS = 10  # of equal width
DOUBT = 1e-3  # chance that is left to what is sure


def signs_of(regions: Regions) -> Array:
    """Describe N regions by what tells how likely they are strokes: (N, `CONFIDENCE_FEATURES`).

    Log-odds of what the judge says, the visible share that the network sees, and log of the area for what length and
    width promise.
    """
    chance = np.clip(regions.chance, DOUBT, 1 - DOUBT)
    odds = np.log(chance / (1 - chance))
    area = np.bincount(regions.labels[regions.labels >= 0], minlength=len(odds))
    filled = np.log(np.maximum(area, 1)) - regions.told[:, 4:6].sum(1)
    return np.stack([odds, regions.told[:, 6], filled], 1)


def calibration_of(confidence: Array, hit: Array) -> dict[str, Any]:
    """Compare confidences (N,) in [0, 1] with whether a stroke was right (N,).

    Returns:
        ``auc``, how often a right stroke has more confidence than a wrong one (NaN if there are none of either);
        ``ece``, the mean distance of confidence and share of right ones, over `BINS` bins weighted by their strokes;
        ``reliability``, (confidence, share right, strokes) of each bin that has strokes.
    """
    right, wrong = confidence[hit], confidence[~hit]
    place = np.minimum((confidence * BINS).astype(int), BINS - 1)
    rows = [
        (float(confidence[place == k].mean()), float(hit[place == k].mean()), int((place == k).sum()))
        for k in range(BINS)
        if (place == k).any()
    ]
    return {"auc": auc_of(right, wrong), "ece": ece_of(rows), "reliability": rows}


def ece_of(reliability: Sequence[tuple[float, float, int]]) -> float:
    """Compute the expected calibration error (Naeini et al., 2015); NaN of no strokes.

    Of few strokes it is large even where the confidence is right: join the reliability of paintings first.
    """
    total = sum(count for *_, count in reliability)
    gap = sum(count * abs(mean - share) for mean, share, count in reliability)
    return gap / total if total else float("nan")


def auc_of(right: Array, wrong: Array) -> float:
    """Compute the area under the ROC curve from ranks (Mann and Whitney, 1947); ties count half."""
    if not len(right) or not len(wrong):
        return float("nan")
    below = np.searchsorted(np.sort(wrong), right, "left") + np.searchsorted(np.sort(wrong), right, "right")
    return float(below.sum() / (2 * len(right) * len(wrong)))


def join_reliability(tables: list[list[tuple[float, float, int]]]) -> list[tuple[float, float, int]]:
    """Join the reliability of several paintings, bin by bin."""
    joined: dict[int, list[tuple[float, float, int]]] = {}
    for mean, share, count in (row for table in tables for row in table):
        joined.setdefault(min(int(mean * BINS), BINS - 1), []).append((mean, share, count))
    rows = []
    for _, group in sorted(joined.items()):
        total = sum(count for *_, count in group)
        rows.append((
            sum(mean * count for mean, _, count in group) / total,
            sum(share * count for _, share, count in group) / total,
            total,
        ))  # fmt: skip
    return rows
