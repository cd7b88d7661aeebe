"""Test that the perceptrons and the models of order and confidence learn from paintings."""

import numpy as np
import pytest
import torch
from brushexp_recovery.find import regions
from brushexp_recovery.join.merge_tree import grow_tree
from brushexp_recovery.model.logistic import fit_logistic, log_odds_of, sigmoid
from brushexp_recovery.model.perceptron import Perceptron, fit_perceptron
from brushexp_recovery.model.recovery_model import RecoveryModel
from brushexp_recovery.segment.region_adjacency import PAIRS
from brushexp_recovery.train import classifiers
from brushexp_recovery.train.classifiers import fit_classifiers
from brushexp_recovery.train.merge_examples import majority, merge_superpixels, roots_at, segment_part
from brushexp_recovery.train.order_and_confidence import fit_order_and_confidence
from brushexp_recovery.train.parts import cut_part
from recovery_scenes import bars, silent


def test_perceptrons_order_and_confidence_learn_from_a_painting(monkeypatch):
    for name in ("FIRST_PAIR_STEPS", "PAIR_STEPS", "NODE_STEPS"):
        monkeypatch.setattr(classifiers, name, 20)
    monkeypatch.setattr(regions, "find_zoom", lambda *_: 0.7)  # an untrained network finds strokes of any width
    model = RecoveryModel().eval()
    losses = fit_classifiers(model, [bars()], 0, silent)
    assert losses.keys() == {"pairs_first", "pairs", "nodes"}
    assert all(np.isfinite(loss) for loss in losses.values())
    figures = fit_order_and_confidence(model, [bars(1.0)], 0)
    assert 0 <= figures["f1"] <= 1
    assert all(np.isfinite(value) for value in figures.values())


def test_superpixels_are_merged_down_to_a_chance():
    part = segment_part(RecoveryModel().eval().network, cut_part(bars(), False, np.random.default_rng(0)))
    superpixels = part.superpixels
    tree = grow_tree(superpixels, None, 0.3)
    assert roots_at(tree, 1.1).tolist() == list(range(tree.leaves))
    roots = roots_at(tree, 0.0)
    assert len(np.unique(roots)) == tree.leaves - len(tree.children)
    graph = merge_superpixels(superpixels, roots)
    for number, root in enumerate(np.unique(roots)):
        np.testing.assert_allclose(graph.moments[number], superpixels.moments[roots == root].sum(0))
    first, second = roots[superpixels.pairs].T
    apart = superpixels.between[first != second]
    assert graph.between[:, PAIRS].sum() == apart[:, PAIRS].sum()
    assert (graph.pairs[:, 0] < graph.pairs[:, 1]).all()


def test_the_stroke_that_most_of_a_region_belongs_to_is_found_with_its_share():
    regions_ = np.array([[0, 0, 0, 1], [0, 1, 1, 1]])
    labels = np.array([[2, 2, -1, 0], [2, 0, 0, -1]])
    stroke, share = majority(regions_, labels, 3)
    assert stroke.tolist() == [2, 0, -1]
    assert share.tolist() == [0.75, 0.75, 0]


@pytest.mark.parametrize("biased", [True, False])
def test_a_logistic_model_finds_the_odds_that_made_its_examples(biased):
    random = np.random.default_rng(0)
    features, weight, bias = random.normal(size=(40_000, 3)) * [1, 10, 0.1], np.array([1.0, -0.05, 4.0]), 0.5 * biased
    chance = sigmoid(features @ weight + bias)
    linear = torch.nn.Linear(3, 1, bias=biased)
    fit_logistic(linear, features, random.random(len(chance)) < chance)
    np.testing.assert_allclose(sigmoid(log_odds_of(linear, features)), chance, atol=0.03)


def test_a_perceptron_learns_and_says_the_same_without_pytorch():
    random = np.random.default_rng(0)
    features = random.normal(size=(500, 4)).astype(np.float32)
    goal = np.stack([features[:, 0] > 0, features[:, 1] > features[:, 2]], 1)
    perceptron = Perceptron(4, 2)
    assert fit_perceptron(perceptron, features, goal, np.ones(500), 150, 0) < 0.3
    weights = perceptron.weights()
    expected = perceptron(torch.from_numpy(features)).sigmoid().detach().numpy()
    np.testing.assert_allclose(weights(features), expected, atol=1e-5)
    assert ((weights(features) > 0.5) == goal).mean() > 0.9
