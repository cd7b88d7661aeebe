"""Compute the features of merge-tree nodes that a perceptron uses to predict whether each node is a stroke."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from brushexp_recovery.join.merge_tree import MergeTree
from brushexp_recovery.join.pair_features import BOUND, LEAST_VARIANCE, LEAST_VISIBLE
from brushexp_recovery.join.shape import RegionShapes, shapes_of
from brushexp_recovery.model.features import NodeFeature
from brushexp_recovery.segment.moments import LAB, LAB_SQUARED, MIDDLE, PREDICTED_CENTRE, PREDICTED_DIRECTION, Moment
from brushexp_recovery.segment.region_adjacency import PAIRS, SUMS, AffinityColumn

Array = NDArray[Any]

INSIDE = slice(NodeFeature.AFFINITY_INSIDE_ADJACENT, NodeFeature.AFFINITY_INSIDE_20 + 1)
OUTSIDE = slice(NodeFeature.AFFINITY_OUTSIDE_ADJACENT, NodeFeature.AFFINITY_OUTSIDE_20 + 1)
COLOR_SPREAD = slice(NodeFeature.LOG_LIGHTNESS_SPREAD, NodeFeature.LOG_B_SPREAD + 1)
PRIOR_PAIRS_INSIDE = 1.0  # number of added pairs of affinity 0.5, which damp the mean of few pairs
PRIOR_PAIRS_OUTSIDE = 0.5


def node_features(tree: MergeTree) -> Array:
    """Compute the features (nodes, len(NodeFeature)) of a tree's nodes as finite float32 values."""
    table = np.empty((len(tree.moments), len(NodeFeature)))
    shapes = shapes_of(tree.moments)
    _write_merges(tree, table)
    _write_region(shapes, table)
    _write_size(shapes, tree.moments[:, Moment.AREA], table)
    return np.nan_to_num(table, nan=0.0, posinf=BOUND, neginf=-BOUND).astype(np.float32)


def _write_merges(tree: MergeTree, table: Array) -> None:
    """Write each node's merge probabilities, and its affinities within itself and to other regions, to ``table``."""
    prior = PRIOR_PAIRS_INSIDE
    table[:, INSIDE] = (tree.within[:, SUMS] + 0.5 * prior) / (tree.within[:, PAIRS] + prior)
    prior = PRIOR_PAIRS_OUTSIDE
    table[:, OUTSIDE] = (tree.around[:, SUMS] + 0.5 * prior) / (tree.around[:, PAIRS] + prior)
    table[:, NodeFeature.MERGE_CHANCE] = tree.merge_chance
    table[:, NodeFeature.NEIGHBOUR_CHANCE] = tree.neighbour_chance
    table[:, NodeFeature.CHANCE_GAP] = tree.merge_chance - tree.neighbour_chance
    area, around = tree.moments[:, Moment.AREA], tree.around
    adjacent, near = around[:, AffinityColumn.PAIRS_ADJACENT], around[:, AffinityColumn.PAIRS_3]
    table[:, NodeFeature.LOG_CONTACT_ADJACENT] = np.log((adjacent + 1) / np.sqrt(area))
    table[:, NodeFeature.LOG_CONTACT_3] = np.log((near + 1) / np.sqrt(area))
    table[:, NodeFeature.LOG_CONTACT_20] = np.log((around[:, AffinityColumn.PAIRS_20] + 1) / area)


def _write_region(shapes: RegionShapes, table: Array) -> None:
    """Write each region's variation in colour, predicted stroke centre and predicted direction to ``table``."""
    mean = shapes.mean
    wide, long = np.exp(mean[:, Moment.LOG_WIDTH]), np.exp(mean[:, Moment.LOG_LENGTH])
    gap = np.linalg.norm(mean[:, PREDICTED_CENTRE] - mean[:, MIDDLE], axis=1)
    variance = np.maximum(mean[:, LAB_SQUARED] - mean[:, LAB] ** 2, LEAST_VARIANCE)
    table[:, COLOR_SPREAD] = np.log(np.sqrt(variance))
    table[:, NodeFeature.PAINT] = mean[:, Moment.PAINT]
    table[:, NodeFeature.LOG_SPREAD] = np.log(shapes.spread / wide)
    table[:, NodeFeature.COHERENCE] = np.linalg.norm(mean[:, PREDICTED_DIRECTION], axis=1)
    table[:, NodeFeature.ALIGNMENT] = shapes.alignment
    table[:, NodeFeature.LOG_CENTRE_GAP] = np.log((gap + 1) / wide)
    table[:, NodeFeature.CENTRE_GAP_BY_LENGTH] = gap / long


def _write_size(shapes: RegionShapes, area: Array, table: Array) -> None:
    """Write the size of each region, relative to the predicted size of its stroke, to ``table``."""
    mean = shapes.mean
    log_width, log_length = mean[:, Moment.LOG_WIDTH], mean[:, Moment.LOG_LENGTH]
    wide, long = np.exp(log_width), np.exp(log_length)
    fill = np.log(area / (wide * long))
    width_variance = mean[:, Moment.LOG_WIDTH_SQUARED] - log_width**2
    length_variance = mean[:, Moment.LOG_LENGTH_SQUARED] - log_length**2
    table[:, NodeFeature.LOG_AREA] = np.log(area)
    table[:, NodeFeature.LOG_FILL] = fill
    table[:, NodeFeature.VISIBLE] = mean[:, Moment.VISIBLE]
    table[:, NodeFeature.LOG_FILL_BY_VISIBLE] = fill - np.log(np.maximum(mean[:, Moment.VISIBLE], LEAST_VISIBLE))
    table[:, NodeFeature.LOG_LENGTH] = np.log(shapes.length / long)
    table[:, NodeFeature.LOG_WIDTH] = np.log(shapes.width / wide)
    table[:, NodeFeature.LOG_COMPACTNESS] = np.log(area / (shapes.length * shapes.width))
    table[:, NodeFeature.LOG_ELONGATION] = np.log(shapes.length / shapes.width)
    table[:, NodeFeature.LOG_PREDICTED_WIDTH] = log_width
    table[:, NodeFeature.LOG_PREDICTED_LENGTH] = log_length
    table[:, NodeFeature.PREDICTED_WIDTH_SPREAD] = np.sqrt(np.maximum(width_variance, 0))
    table[:, NodeFeature.PREDICTED_LENGTH_SPREAD] = np.sqrt(np.maximum(length_variance, 0))
