"""Score strokes that somebody found against those that are known.

A pair of a known and a found stroke matches where the regions in which they are seen have an intersection over union
above `HIT`; each has one partner. Known strokes count that show 30 % of their area and 12 pixels
(`truth.Truth.counts`), found ones likewise; one that lies mostly on bare ground, or whose partner does not count, is
neither good nor bad.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from brushexp_recovery.calibration import calibration_of
from brushexp_recovery.given import Given
from brushexp_recovery.neighbourhood import field_errors
from brushexp_recovery.outlines import lengths_of
from brushexp_recovery.raster.labels import count_pixels
from brushexp_recovery.raster.overlap import overlaps_between
from brushexp_recovery.truth import LEAST, VISIBLE, Truth

Array = NDArray[Any]

HIT, NEAR = 0.5, 0.3  # intersection over union from which on two regions match, and match softly
BARE = 0.5  # share of a found stroke on bare ground from which on it is not judged
LONG = 1.5  # widths: a shorter stroke has no direction
SHARES = {"little": (0.3, 0.6), "most": (0.6, 0.9), "whole": (0.9, np.inf)}  # of a stroke that is seen


@dataclass(frozen=True)
class Matched:
    """Which found strokes are which known ones."""

    truth: Array  # (M,) known strokes that count
    found: Array  # (M,) their partners
    iou: Array  # (M,) of their regions
    neutral: Array  # (N,) whether a found stroke's partner is a known one that does not count
    asked: Array  # (N,) whether a found stroke is good or bad


def score(truth: Truth, given: Given) -> dict[str, Any]:
    """Compute all figures; those that are not defined are NaN.

    Keys: ``f1``, ``recall``, ``precision`` (and ``_soft``, at `NEAR`), ``best_iou``, ``split`` and ``joined``,
    ``recall_little``, ``_most`` and ``_whole`` by the visible share, medians over matched strokes ``direction_deg``,
    ``length_rel``, ``width_rel``, ``width_bias``, ``color_de00`` (CIEDE2000) and mean ``iou``, ``order_agreement``,
    ``order_tau`` and ``order_pairs``, errors of neighbourhoods ``field_...``, and with confidence ``auc``, ``ece`` and
    ``reliability``.
    """
    counts_found = counting(given)
    rows, columns, iou = overlaps_between(truth.labels, given.labels, len(truth), len(given))
    figures: dict[str, Any] = {"truth": int(truth.counts.sum()), "predicted": int(counts_found.sum())}
    for suffix, least in (("_soft", NEAR), ("", HIT)):
        matched = match(truth, given, counts_found, (rows, columns, iou), least)
        figures |= {name + suffix: value for name, value in rates_of(truth, counts_found, matched).items()}
    figures |= {f"recall_{name}": value for name, value in recall_by_share(truth, matched).items()}
    best = np.zeros(len(truth))
    np.maximum.at(best, rows, iou)
    figures["best_iou"] = mean_of(best[truth.counts])
    figures["split"] = parts_of(truth.labels, given.labels, truth.counts)
    figures["joined"] = parts_of(given.labels, truth.labels, counts_found)
    figures |= errors_of(truth, given, matched) | order_of(truth, given, matched)
    figures |= field_errors(truth, given, truth.counts, matched.asked & counts_found)
    if given.confidence is not None:
        hit = np.isin(np.arange(len(given)), matched.found)
        figures |= calibration_of(given.confidence[matched.asked], hit[matched.asked])
    return figures


def counting(given: Given) -> Array:
    """Tell which found strokes (N,) show enough of themselves to be judged."""
    seen: Array = count_pixels(given.labels, len(given))
    return (seen >= VISIBLE * given.area) & (seen >= LEAST)


def match(
    truth: Truth, given: Given, counts_found: Array, overlap: tuple[Array, Array, Array], least: float
) -> Matched:
    """Pair strokes one to one, the best first, with at least the intersection over union ``least``."""
    taken: tuple[dict[int, float], dict[int, float]] = ({}, {})
    pairs = []
    for row, column, iou in sorted(zip(*overlap, strict=True), key=lambda one: -one[2]):
        if iou >= least and row not in taken[0] and column not in taken[1]:
            taken[0][row] = taken[1][column] = iou
            pairs.append((row, column, iou))
    table = np.array(pairs).reshape(-1, 3)
    known, found = table[:, 0].astype(int), table[:, 1].astype(int)
    good = truth.counts[known]
    neutral, hit = np.zeros(len(given), bool), np.zeros(len(given), bool)
    neutral[found[~good]], hit[found[good]] = True, True
    asked = counts_found & (hit | ~(neutral | on_ground(truth, given)))
    return Matched(known[good], found[good], table[good, 2], neutral, asked)


def on_ground(truth: Truth, given: Given) -> Array:
    """Tell which found strokes (N,) lie mostly where the truth has no stroke."""
    bare = count_pixels(np.where(truth.labels < 0, given.labels, -1), len(given))
    wrong: Array = bare > BARE * count_pixels(given.labels, len(given))
    return wrong


def rates_of(truth: Truth, counts_found: Array, matched: Matched) -> dict[str, float]:
    """Compute recall, precision and F1."""
    recall = len(matched.truth) / max(int(truth.counts.sum()), 1)
    precision = int(counts_found[matched.found].sum()) / max(int(matched.asked.sum()), 1)
    total = recall + precision
    return {"recall": recall, "precision": precision, "f1": 2 * recall * precision / total if total else 0.0}


def recall_by_share(truth: Truth, matched: Matched) -> dict[str, float]:
    """Compute the recall of known strokes by the share of them that is seen."""
    found = np.isin(np.arange(len(truth)), matched.truth)
    groups = {name: truth.counts & (truth.share >= low) & (truth.share < high) for name, (low, high) in SHARES.items()}
    return {name: mean_of(found[group]) for name, group in groups.items()}


def parts_of(a: Array, b: Array, chosen: Array) -> float:
    """Count into how many regions of ``b`` a chosen one of ``a`` falls, 1 / sum of squared shares; the median."""
    inside = a >= 0
    most = int(b.max(initial=-1)) + 2
    pair, shared = np.unique(a[inside].astype(np.int64) * most + b[inside] + 1, return_counts=True)
    total, squares = (np.bincount(pair // most, weight, len(chosen)) for weight in (shared, shared**2.0))
    return median_of((total**2 / np.maximum(squares, 1))[chosen])


def errors_of(truth: Truth, given: Given, matched: Matched) -> dict[str, float]:
    """Compute medians of the errors of matched strokes."""
    from skimage.color import deltaE_ciede2000, rgb2lab  # noqa: PLC0415

    known, found = matched.truth, matched.found
    width = truth.width[known]
    length = lengths_of(truth.curve[known]) + width
    found_length = lengths_of(given.curve[found]) + given.width[found]
    turn = angle_between(chords(truth.curve[known]), chords(given.curve[found]))
    lab, found_lab = (rgb2lab(color[None].clip(0, 1)) for color in (truth.seen[known], given.color[found]))
    return {
        "direction_deg": median_of(turn[length > LONG * width]),
        "length_rel": median_of(np.abs(found_length / length - 1)),
        "width_rel": median_of(np.abs(given.width[found] / width - 1)),
        "width_bias": median_of(given.width[found] / width - 1),
        "color_de00": median_of(deltaE_ciede2000(lab, found_lab)[0]),
        "iou": mean_of(matched.iou),
    }


def order_of(truth: Truth, given: Given, matched: Matched) -> dict[str, float]:
    """Compute the share of overlapping matched pairs in the right order, and Kendall's tau: 1 always, -1 never."""
    if not given.ordered:
        return {"order_tau": float("nan"), "order_agreement": float("nan"), "order_pairs": 0}
    rank = np.full(len(truth), -1)
    rank[matched.truth] = matched.found
    lower, upper = truth.pairs[(rank[truth.pairs] >= 0).all(1)].T
    right = rank[upper] > rank[lower]
    return {"order_tau": mean_of(2.0 * right - 1), "order_agreement": mean_of(right), "order_pairs": len(lower)}


def chords(curve: Array) -> Array:
    """Return the angles (N,) of lines from start to end, radians."""
    x, y = (curve[:, 2] - curve[:, 0]).T
    return np.arctan2(y, x)


def angle_between(a: Array, b: Array) -> Array:
    """Return the angles in degrees, 0 to 90, between directions in radians."""
    return np.degrees(np.abs((a - b + np.pi / 2) % np.pi - np.pi / 2))


def median_of(values: Array) -> float:
    """Return the median; NaN of nothing."""
    return float(np.median(values)) if len(values) else float("nan")


def mean_of(values: Array) -> float:
    """Return the mean; NaN of nothing."""
    return float(np.mean(values)) if len(values) else float("nan")
