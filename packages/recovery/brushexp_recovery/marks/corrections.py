"""Replace recovered strokes according to a person's corrections."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from brushexp.contracts import UserError
from brushexp.contracts.strokes import curve_of
from brushexp_recovery.curves.fit import StrokeCurves
from brushexp_recovery.curves.round_line import width_of_line
from brushexp_recovery.marks.mark_regions import overlaps_of_pixels, pixels_of_mark
from brushexp_recovery.marks.marks_file import Mark, Marks, read_marks
from brushexp_recovery.raster.labels import group_pixels, mean_colors
from brushexp_recovery.raster.overlap import MATCH_IOU
from brushexp_recovery.recover.pipeline import catalogue_of
from brushexp_recovery.recover.storage import Recovered

Array = NDArray[Any]

REPLACED = 0.5  # share of a recovered stroke covered by hand-drawn marks above which they replace it
SURE = 1.0  # confidence of a hand-drawn mark


def check_marks(path: Path, size: tuple[int, int]) -> None:
    """Raise UserError if a file contains no marks, or if its marks are for a picture whose size is not (H, W)."""
    marks = read_marks(path)
    if marks.size is not None and marks.size != size:
        raise UserError(
            f"marks={path} belong to a picture of {marks.size[1]} x {marks.size[0]} pixels, but image= has {size[1]} x "
            f"{size[0]}; give the photograph on which they were drawn"
        )


def correct(recovered: Recovered, marks: Marks, image: Array) -> Recovered:
    """Correct the strokes recovered from an image (H, W, 3) in [0, 1] according to a person's marks.

    - A recovered stroke is removed if it matches a deleted stroke, or is mostly covered by hand-drawn marks.
    - Hand-drawn marks are added with a confidence of 1, on top of all strokes because their order is unknown.
    - All other strokes stay unchanged.
    """
    size = recovered.labels.shape
    hand = [mark for mark in marks.strokes if mark.by == "hand"]
    regions = [pixels_of_mark(mark, size) for mark in hand]
    kept = ~is_corrected(recovered, [pixels_of_mark(mark, size) for mark in marks.deleted], regions)
    number = np.append(np.where(kept, np.cumsum(kept) - 1, -1), -1)  # the last entry is for -1
    labels = number[recovered.labels].astype(np.int32)
    for place, region in enumerate(regions, start=int(kept.sum())):
        labels.flat[region] = place
    strokes, bottom_up = recovered.saved.strokes, recovered.saved.depth.argsort().numpy()
    by_hand = curves_of(hand, regions)
    curve = np.concatenate([curve_of(strokes).double().numpy()[kept], by_hand.curve])
    width = np.concatenate([(strokes.width * strokes.scale).double().numpy()[kept], by_hand.width])
    by_place = mean_colors(labels, image, len(width))
    color = np.concatenate([strokes.color.double().numpy()[kept], by_place[kept.sum() :]])
    confidence = np.append(recovered.confidence[kept], np.full(len(hand), SURE))
    order = np.append(number[bottom_up[kept[bottom_up]]], np.arange(kept.sum(), len(width))).astype(int)
    meet = kept[recovered.meetings].all(1)
    corrected = catalogue_of(labels, StrokeCurves(curve, width, color), confidence, order, image)
    meetings = np.argsort(order)[number[recovered.meetings[meet]]]
    ground = None if recovered.ground is None else recovered.ground & (labels < 0)
    return replace(corrected, meetings=meetings, chance_above=recovered.chance_above[meet], ground=ground)


def is_corrected(recovered: Recovered, deleted: Sequence[Array], hand: Sequence[Array]) -> Array:
    """Check which recovered strokes (N,) a person has deleted or replaced; regions are given as flat indices."""
    found = [pixels.astype(np.int64) for pixels in group_pixels(recovered.labels, len(recovered.confidence))]
    overlaps = overlaps_of_pixels(deleted, found, recovered.labels.size)
    gone = np.zeros(len(found), bool)
    gone[overlaps.second[overlaps.iou >= MATCH_IOU]] = True
    covered = np.zeros(recovered.labels.size, bool)
    for region in hand:
        covered[region] = True
    replaced = [len(pixels) > 0 and covered[pixels].mean() >= REPLACED for pixels in found]
    return gone | np.array(replaced, bool)


def curves_of(marks: Sequence[Mark], regions: Sequence[Array]) -> StrokeCurves:
    """Fit curves (N, 3, 2) to the lines of marks, with widths (N,) that match the areas of the marks' regions."""
    curve, width = np.empty((len(marks), 3, 2)), np.empty(len(marks))
    for number, (mark, region) in enumerate(zip(marks, regions, strict=True)):
        curve[number] = fit_line(mark.points)
        broad = float(mark.width.mean())
        extent = np.linalg.norm(np.diff(mark.points, axis=0), axis=1).sum() + broad
        width[number] = width_of_line(len(region), extent) if len(region) else broad
    return StrokeCurves(curve, width, np.zeros((len(marks), 3)))


def fit_line(points: Array) -> Array:
    """Fit a quadratic Bezier curve (3, 2) from the first to the last of the points (P, 2) by least squares."""
    start, end = points[0], points[-1]
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    t = np.append(0, np.cumsum(steps)) / max(float(steps.sum()), 1e-9)
    weight = 2 * t * (1 - t)
    rest = points - np.outer((1 - t) ** 2, start) - np.outer(t**2, end)
    square = weight @ weight
    control = weight @ rest / square if square > 0 else 0.5 * (start + end)
    return np.stack([start, control, end])
