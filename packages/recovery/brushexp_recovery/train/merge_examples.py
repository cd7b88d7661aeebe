"""Make training examples for the perceptrons: pairs of regions, and nodes of merge trees, with their targets."""

from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from brushexp_recovery.find.look import SMALLEST_REGION
from brushexp_recovery.join.merge_tree import MergeTree
from brushexp_recovery.join.node_features import node_features
from brushexp_recovery.join.node_overlap import node_overlaps
from brushexp_recovery.join.pair_features import pair_features
from brushexp_recovery.model.features import NodeScore
from brushexp_recovery.model.unet import StrokeNetwork
from brushexp_recovery.raster.overlap import MATCH_IOU
from brushexp_recovery.raster.resampling import nearest_pixels, resample
from brushexp_recovery.segment.affinity_maps import predict_maps
from brushexp_recovery.segment.moments import Moment
from brushexp_recovery.segment.region_adjacency import AffinityColumn
from brushexp_recovery.segment.superpixels import Superpixels, superpixels_of
from brushexp_recovery.synthesis.hand import Random
from brushexp_recovery.train.parts import PaintingPart

Array = NDArray[Any]

COPIES = 2  # number of rotated and mirrored copies over which maps are averaged
CLEAR_SHARE = 0.6  # minimum share of one stroke in a region used as an example
MOST_PAIRS = 9000  # maximum number of examples from one part of a painting and one stage of merging
AREA_POWER = 0.35  # power of the smaller area in the weight of a pair
FAR_WEIGHT = 0.3  # weight of pairs of pixels 8 or 20 pixels apart; closer pairs have weight 1
LEAST_CONTACT = 1.0  # minimum weighted number of pairs of pixels
BEFORE_MERGING = 1.1  # exceeds the chance of any merge
STAGES = (BEFORE_MERGING, 0.9, 0.75, 0.5, 0.3)  # chances down to which regions are merged before pairs are taken


class SegmentedPart(NamedTuple):
    """A part of a painting, divided into superpixels, with the visible stroke at each pixel."""

    superpixels: Superpixels
    labels: Array  # (H, W), -1 for the ground


class Examples(NamedTuple):
    """N examples for a perceptron."""

    features: Array  # (N, F) float32
    goals: Array  # (N, outputs) in [0, 1]
    weights: Array  # (N,)


class RegionGraph(NamedTuple):
    """Superpixels merged into N regions, and P pairs of regions with affinities."""

    region: Array  # (S,) region of each superpixel
    moments: Array  # (N, len(Moment))
    pairs: Array  # (P, 2)
    between: Array  # (P, len(AffinityColumn))


def join_examples(examples: Iterable[Examples]) -> Examples:
    """Concatenate several sets of examples."""
    features, goals, weights = (np.concatenate(column) for column in zip(*examples, strict=True))
    return Examples(features, goals, weights)


def segment_part(network: StrokeNetwork, part: PaintingPart) -> SegmentedPart:
    """Divide a part of a painting into superpixels, at approximately the best scale for its strokes."""
    image = resample(part.image, part.zoom)
    rows, columns = (nearest_pixels(size, own) for size, own in zip(image.shape[:2], part.labels.shape, strict=True))
    maps = predict_maps(network, image, COPIES)
    return SegmentedPart(superpixels_of(maps, image), part.labels[np.ix_(rows, columns)])


def pair_examples(part: SegmentedPart, tree: MergeTree, random: Random, knows_ground: bool = True) -> Examples:
    """Make examples of the region pairs that exist at each of the `STAGES` of merging.

    If ``knows_ground`` is false, a label of -1 means unknown, and pairs of two unknown regions are excluded.
    """
    return join_examples([_pairs_at(part, tree, stage, random, knows_ground) for stage in STAGES])


def _pairs_at(
    part: SegmentedPart, tree: MergeTree, least_chance: float, random: Random, knows_ground: bool
) -> Examples:
    """Make examples of the region pairs that remain after all merges of probability ``least_chance`` or higher."""
    graph = merge_superpixels(part.superpixels, roots_at(tree, least_chance))
    stroke, share = majority(graph.region[part.superpixels.labels], part.labels, len(graph.moments))
    first, second = graph.pairs.T
    near = graph.between[:, [AffinityColumn.PAIRS_ADJACENT, AffinityColumn.PAIRS_3]].sum(1)
    far = graph.between[:, [AffinityColumn.PAIRS_8, AffinityColumn.PAIRS_20]].sum(1)
    is_clear = (share[first] > CLEAR_SHARE) & (share[second] > CLEAR_SHARE)
    is_known = knows_ground | (stroke[first] >= 0) | (stroke[second] >= 0)
    rows = np.flatnonzero(is_clear & is_known & (near + FAR_WEIGHT * far > LEAST_CONTACT))
    rows = random.choice(rows, MOST_PAIRS, replace=False) if len(rows) > MOST_PAIRS else rows
    first, second = first[rows], second[rows]
    features = pair_features(graph.moments, graph.pairs[rows], graph.between[rows])
    area = graph.moments[:, Moment.AREA]
    weights = np.minimum(area[first], area[second]) ** AREA_POWER
    return Examples(features, (stroke[first] == stroke[second])[:, None], weights)


def roots_at(tree: MergeTree, least_chance: float) -> Array:
    """Find the root node of each superpixel (S,) after all merges of probability ``least_chance`` or higher."""
    roots = np.arange(len(tree.moments))
    for number in range(len(tree.children) - 1, -1, -1):
        node = tree.leaves + number
        if roots[node] != node or tree.merge_chance[node] >= least_chance:
            roots[tree.children[number]] = roots[node]
    return roots[: tree.leaves]


def merge_superpixels(superpixels: Superpixels, roots: Array) -> RegionGraph:
    """Merge the superpixels that have the same root (S,) into regions."""
    regions, region = np.unique(roots, return_inverse=True)
    count = len(regions)
    moments = np.stack([np.bincount(region, column, minlength=count) for column in superpixels.moments.T], 1)
    first, second = region[superpixels.pairs].T
    apart = first != second
    keys = np.minimum(first, second)[apart].astype(np.int64) * count + np.maximum(first, second)[apart]
    key, pair = np.unique(keys, return_inverse=True)
    columns = superpixels.between[apart].T
    between = np.stack([np.bincount(pair, column, minlength=len(key)) for column in columns], 1)
    return RegionGraph(region, moments, np.stack([key // count, key % count], 1), between)


def majority(regions: Array, labels: Array, count: int) -> tuple[Array, Array]:
    """Find the stroke (-1 for the ground) that covers most of each of ``count`` regions, and the fraction it covers."""
    base = int(labels.max()) + 2
    key, number = np.unique(regions.ravel().astype(np.int64) * base + labels.ravel() + 1, return_counts=True)
    region, stroke = key // base, key % base - 1
    order = np.lexsort((-number, region))
    first = order[np.r_[True, region[order][1:] != region[order][:-1]]]
    winner, share = np.full(count, -1), np.zeros(count)
    winner[region[first]] = stroke[first]
    share[region[first]] = number[first] / np.bincount(regions.ravel(), minlength=count)[region[first]]
    return winner, share


def node_examples(part: SegmentedPart, tree: MergeTree) -> Examples:
    """Make examples of nodes, whose targets are the best IoU with any stroke and whether it counts as a match."""
    chosen = tree.moments[:, Moment.AREA] >= SMALLEST_REGION
    overlaps = node_overlaps(tree, part.superpixels.labels, part.labels, int(part.labels.max()) + 1)
    return examples_of_nodes(tree, chosen, overlaps.max(1, initial=0))


def examples_of_nodes(tree: MergeTree, chosen: Array, iou: Array) -> Examples:
    """Make examples of the ``chosen`` nodes (nodes,), given the intersection over union (nodes,) with their strokes."""
    goals = np.empty((int(chosen.sum()), len(NodeScore)))
    goals[:, NodeScore.MATCH] = iou[chosen] >= MATCH_IOU
    goals[:, NodeScore.IOU] = iou[chosen]
    return Examples(node_features(tree)[chosen], goals, np.ones(len(goals)))
