"""Adapt the models that score regions to one painting, using a person's marks in it.

Only the last layers of the perceptrons change, and a penalty keeps them close to their initial weights, because a
person draws only about twenty marks.
"""

import copy
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from brushexp_recovery.find.look import SMALLEST_REGION, join_superpixels
from brushexp_recovery.find.regions import TILE_SIDE
from brushexp_recovery.find.scale import BEST_WIDTH, SCALES, find_zoom
from brushexp_recovery.join.merge_tree import MergeTree, grow_tree
from brushexp_recovery.join.node_overlap import node_overlaps
from brushexp_recovery.marks.mark_regions import pixels_of_mark
from brushexp_recovery.marks.marks_file import Mark, Marks
from brushexp_recovery.model.perceptron import Perceptron, fit_last_layer
from brushexp_recovery.model.recovery_model import Classifiers, RecoveryModel
from brushexp_recovery.raster.labels import count_pixels
from brushexp_recovery.raster.overlap import MATCH_IOU, overlaps_between
from brushexp_recovery.raster.resampling import nearest_pixels, resample
from brushexp_recovery.raster.tiles import split_into_tiles
from brushexp_recovery.segment.affinity_maps import predict_maps
from brushexp_recovery.segment.moments import Moment
from brushexp_recovery.segment.superpixels import superpixels_of
from brushexp_recovery.train.merge_examples import (
    Examples,
    SegmentedPart,
    examples_of_nodes,
    join_examples,
    pair_examples,
)

Array = NDArray[Any]

FEWEST_MARKS = 5  # minimum number of hand-drawn marks for adapting scale and judges
NEAR = 1.4  # maximum ratio to the scale of the marks at which the scale chosen without marks is kept
ON_MARKS = 0.5  # share of a region on marks above which they decide whether it is a stroke
RIDGE = 0.03  # weight of the squared changes of a last layer in the loss, divided by the number of marks


class MarkedPart(NamedTuple):
    """A part of a painting, divided into superpixels, with a person's marks."""

    segmented: SegmentedPart  # with hand-drawn marks as labels; -1 is unknown
    deleted: Array  # (h, w) recovered strokes that the person has deleted, or -1 for none


def marks_by_hand(marks: Marks) -> list[Mark]:
    """List the marks that a person has drawn, split or joined by hand."""
    return [mark for mark in marks.strokes if mark.by == "hand"]


def scale_for(marks: Marks) -> float:
    """Compute the scale at which hand-drawn marks have the stroke width that suits the network best."""
    width = float(np.median([mark.width.mean() for mark in marks_by_hand(marks)]))
    return float(np.clip(BEST_WIDTH / width, *SCALES))


def choose_scale(model: RecoveryModel, image: Array, marks: Marks) -> float:
    """Choose the scale at which an image (H, W, 3) with marks is searched for strokes.

    The scale chosen without marks is kept unless the scale derived from the marks differs from it considerably, and a
    look at the derived scale agrees better with the marks.
    """
    classifiers = model.classifiers()
    by_marks, alone = scale_for(marks), find_zoom(model, classifiers, image)
    if abs(np.log(alone / by_marks)) <= np.log(NEAR):
        return alone
    agreement = {
        scale: agreement_with(segment_marked_parts(model, image, marks, scale), classifiers)
        for scale in (alone, by_marks)
    }
    return max(agreement, key=lambda scale: agreement[scale])


def fit_judges(model: RecoveryModel, image: Array, marks: Marks, scale: float, seed: int) -> RecoveryModel:
    """Fit a model's region scorers to the marks in an image (H, W, 3), if this helps on held-out marks.

    A copy of the model is fitted and returned if scorers fitted to one half of the marks agree better with the other
    half than the original scorers do; otherwise the model itself is returned.
    """
    parts = segment_marked_parts(model, image, marks, scale)
    if not parts:
        return model
    gain = 0.0
    for half in range(2):
        taught = fit_to(model, [marks_in_half(part, half) for part in parts], seed)
        rest = [marks_in_half(part, 1 - half) for part in parts]
        gain += agreement_with(rest, taught.classifiers()) - agreement_with(rest, model.classifiers())
    return fit_to(model, parts, seed) if gain > 0 else model


def fit_to(model: RecoveryModel, parts: Sequence[MarkedPart], seed: int) -> RecoveryModel:
    """Copy a model, and fit the region scorers of the copy to the marked parts of a painting."""
    fitted, random = copy.deepcopy(model), np.random.default_rng(seed)
    labels = np.concatenate([part.segmented.labels.ravel() for part in parts])
    count = max(len(np.unique(labels[labels >= 0])), 1)
    trees = [grow_tree(part.segmented.superpixels, model.pairs.weights()) for part in parts]
    pairs = [
        pair_examples(part.segmented, tree, random, knows_ground=False) for part, tree in zip(parts, trees, strict=True)
    ]
    _fit(fitted.pairs, pairs, count)
    trees = [grow_tree(part.segmented.superpixels, fitted.pairs.weights()) for part in parts]
    nodes = [marked_nodes(part, tree) for part, tree in zip(parts, trees, strict=True)]
    _fit(fitted.nodes, nodes, count)
    return fitted


def marks_in_half(part: MarkedPart, half: int) -> MarkedPart:
    """Keep every second mark of a part, starting at mark ``half``; pixels of other marks become unknown."""
    labels = part.segmented.labels
    return part._replace(segmented=part.segmented._replace(labels=np.where(labels % 2 == half, labels, -1)))


def agreement_with(parts: Sequence[MarkedPart], classifiers: Classifiers) -> float:
    """Compute the mean intersection over union between each mark and the region of one look that matches it best."""
    best = []
    for (superpixels, labels), _ in parts:
        look = join_superpixels(superpixels, classifiers)
        count = int(labels.max()) + 1
        overlaps = overlaps_between(labels, look.regions, count, len(look.nodes))
        iou = np.zeros(count)
        np.maximum.at(iou, overlaps.first, overlaps.iou)
        best.append(iou[count_pixels(labels, count) >= SMALLEST_REGION])
    return float(np.concatenate(best).mean()) if sum(map(len, best)) else 0.0


def segment_marked_parts(model: RecoveryModel, image: Array, marks: Marks, scale: float) -> list[MarkedPart]:
    """Divide the tiles of an image (H, W, 3) that contain hand-drawn marks into superpixels."""
    height, width = image.shape[:2]
    by_hand, deleted = (label_image(some, (height, width)) for some in (marks_by_hand(marks), marks.deleted))
    parts = []
    for tile in split_into_tiles(height, width, scale, TILE_SIDE):
        place = tile.box.slices
        if (by_hand[place] < 0).all():
            continue
        shown = resample(image[place], scale)
        pixels = np.ix_(*(nearest_pixels(side, own) for side, own in zip(shown.shape[:2], tile.box.size, strict=True)))
        superpixels = superpixels_of(predict_maps(model.network, shown, 1), shown)
        parts.append(MarkedPart(SegmentedPart(superpixels, by_hand[place][pixels]), deleted[place][pixels]))
    return parts


def label_image(marks: Sequence[Mark], size: tuple[int, int]) -> Array:
    """Draw marks on a canvas (H, W) as labels, with later marks on top; pixels outside all marks are -1."""
    labels = np.full(size, -1)
    for number, mark in enumerate(marks):
        labels.flat[pixels_of_mark(mark, size)] = number
    return labels


def marked_nodes(part: MarkedPart, tree: MergeTree) -> Examples:
    """Make examples of the nodes that are mostly covered by marks, or that match a mark or a deleted stroke."""
    (superpixels, labels), deleted = part
    overlap, wrong = (
        node_overlaps(tree, superpixels.labels, regions, int(regions.max()) + 1).max(1, initial=0)
        for regions in (labels, deleted)
    )
    share = share_on(labels >= 0, superpixels.labels, tree)
    is_known = (share >= ON_MARKS) | (overlap >= MATCH_IOU) | (wrong >= MATCH_IOU)
    chosen = is_known & (tree.moments[:, Moment.AREA] >= SMALLEST_REGION)
    return examples_of_nodes(tree, chosen, overlap)


def share_on(mask: Array, superpixels: Array, tree: MergeTree) -> Array:
    """Compute the fraction (nodes,) of each tree node that is inside a mask (h, w)."""
    pixels = np.zeros(len(tree.moments))
    pixels[: tree.leaves] = np.bincount(superpixels[mask], minlength=tree.leaves)
    for number, (one, other) in enumerate(tree.children):
        pixels[tree.leaves + number] = pixels[one] + pixels[other]
    return pixels / tree.moments[:, Moment.AREA]


def _fit(perceptron: Perceptron, examples: Iterable[Examples], marks: int) -> None:
    """Fit the last layer of a perceptron to examples made from the given number of marks."""
    features, goals, weights = join_examples(examples)
    fit_last_layer(perceptron, features, goals, weights, RIDGE / marks)
