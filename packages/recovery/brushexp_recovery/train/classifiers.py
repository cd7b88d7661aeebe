"""Fit the perceptrons for pairs and nodes on paintings that were not used to train the network."""

from collections.abc import Iterable

import numpy as np

from brushexp_recovery.join.merge_tree import grow_tree
from brushexp_recovery.model.perceptron import Perceptron, fit_perceptron
from brushexp_recovery.model.recovery_model import RecoveryModel
from brushexp_recovery.raster.threads import Progress
from brushexp_recovery.synthesis.paintings import KnownPainting
from brushexp_recovery.train.merge_examples import (
    STAGES,
    Examples,
    join_examples,
    node_examples,
    pair_examples,
    segment_part,
)
from brushexp_recovery.train.parts import cut_part

FIRST_PAIR_STEPS = 1500  # number of steps on pairs from merging by affinity
PAIR_STEPS = 3000  # number of steps on pairs that also come from merging by the first perceptron
NODE_STEPS = 5000


def fit_classifiers(
    model: RecoveryModel, paintings: Iterable[KnownPainting], seed: int, show: Progress
) -> dict[str, float]:
    """Fit the perceptrons of a model on clean and weathered paintings, and return their losses."""
    random = np.random.default_rng(seed)
    parts = [
        segment_part(model.network, cut_part(painting, is_weathered, random))
        for painting in paintings
        for is_weathered in (False, True)
    ]
    show(0.4, "pairs")
    trees = [grow_tree(part.superpixels, None, min(STAGES)) for part in parts]
    by_affinity = [pair_examples(part, tree, random) for part, tree in zip(parts, trees, strict=True)]
    first_loss = _fit(model.pairs, by_affinity, FIRST_PAIR_STEPS, seed)
    show(0.6, "pairs")
    trees = [grow_tree(part.superpixels, model.pairs.weights()) for part in parts]
    by_perceptron = [pair_examples(part, tree, random) for part, tree in zip(parts, trees, strict=True)]
    pair_loss = _fit(model.pairs, [*by_affinity, *by_perceptron], PAIR_STEPS, seed)
    show(0.8, "strokes")
    trees = [grow_tree(part.superpixels, model.pairs.weights()) for part in parts]
    nodes = [node_examples(part, tree) for part, tree in zip(parts, trees, strict=True)]
    return {"pairs_first": first_loss, "pairs": pair_loss, "nodes": _fit(model.nodes, nodes, NODE_STEPS, seed)}


def _fit(perceptron: Perceptron, examples: Iterable[Examples], steps: int, seed: int) -> float:
    """Fit a perceptron on the examples from all parts of paintings, and return its loss."""
    features, goals, weights = join_examples(examples)
    return fit_perceptron(perceptron, features, goals, weights, steps, seed)
