"""Test that region scorers learn from a few hand-drawn marks, and that the scale of a painting follows their width."""

import copy

import numpy as np
import pytest
import torch
from brushexp_recovery.join.merge_tree import grow_tree
from brushexp_recovery.join.node_features import node_features
from brushexp_recovery.marks.marks_file import Mark, Marks
from brushexp_recovery.measure.contours import outlines_of
from brushexp_recovery.model.features import NodeScore
from brushexp_recovery.model.perceptron import Perceptron, fit_last_layer
from brushexp_recovery.model.recovery_model import RecoveryModel
from brushexp_recovery.train import marked_painting
from brushexp_recovery.train.marked_painting import (
    agreement_with,
    fit_judges,
    fit_to,
    label_image,
    marked_nodes,
    scale_for,
    segment_marked_parts,
    share_on,
)
from brushexp_recovery.train.merge_examples import pair_examples
from recovery_scenes import bristles, picture_of, shipped

SIZE = (96, 128)


def level(y: float, width: float = 8, left: float = 10, right: float = 110, by: str = "hand") -> Mark:
    return Mark(f"{y}", np.array([[left, y], [right, y]]), np.full(2, width), (), by)


def marks_of(*strokes: Mark, deleted: tuple[Mark, ...] = ()) -> Marks:
    return Marks(list(strokes), list(deleted), SIZE, None, complete=False)


def test_the_scale_brings_the_marks_by_hand_to_the_width_that_the_network_knows():
    marks = marks_of(level(10, 36), level(50, 40), level(80, 30), level(20, 2, by="recovery"))
    assert scale_for(marks) == pytest.approx(18 / 36)
    assert scale_for(marks_of(level(10, 900))) == 0.15


@pytest.mark.parametrize(("alone", "chosen"), [(0.6, 0.6), (0.4, 0.4), (1.0, 0.5), (0.2, 0.2)])
def test_the_scale_of_the_marks_is_taken_where_it_is_far_and_agrees_more(alone, chosen, monkeypatch):
    monkeypatch.setattr(marked_painting, "find_zoom", lambda *_: alone)
    monkeypatch.setattr(marked_painting, "segment_marked_parts", lambda *words: words[-1])
    monkeypatch.setattr(marked_painting, "agreement_with", lambda scale, _: {0.5: 0.3, 1.0: 0.2, 0.2: 0.4}[scale])
    image = np.zeros((*SIZE, 3), np.float32)
    assert marked_painting.choose_scale(shipped(), image, marks_of(level(10, 36))) == pytest.approx(chosen)


def test_only_known_pairs_and_nodes_are_examples():
    image = picture_of(bristles(SIZE, 2))
    marks = marks_of(level(20), level(40), deleted=(level(70, left=20, right=90),))
    (part,) = segment_marked_parts(shipped(), image, marks, 1.0)
    assert sorted(np.unique(part.segmented.labels)) == [-1, 0, 1]
    tree = grow_tree(part.segmented.superpixels, shipped().pairs.weights())
    every, known = (
        pair_examples(part.segmented, tree, np.random.default_rng(0), knows_ground=knows) for knows in (True, False)
    )
    assert 0 < len(known.features) < len(every.features)
    share = share_on(part.segmented.labels >= 0, part.segmented.superpixels.labels, tree)
    assert share[: tree.leaves].max() <= 1
    assert share[-1] < 0.5
    nodes = marked_nodes(part, tree)
    assert 0 < len(nodes.features) < len(node_features(tree))
    assert (nodes.goals[:, NodeScore.MATCH] == (nodes.goals[:, NodeScore.IOU] >= 0.5)).all()


def test_a_last_layer_learns_examples_as_far_as_the_penalty_lets_it():
    torch.manual_seed(0)
    features = np.random.default_rng(0).normal(size=(80, 5)).astype(np.float32)
    goals = (features[:, :1] > 0).astype(float)
    right, moved = [], []
    for ridge in (1e-4, 1e4):
        torch.manual_seed(1)
        perceptron = Perceptron(5)
        before = perceptron.layers[-1].weight.detach().clone()
        fit_last_layer(perceptron, features, goals, np.ones(80), ridge)
        right.append(((perceptron.weights()(features) > 0.5) == goals).mean())
        moved.append(float((perceptron.layers[-1].weight.detach() - before).abs().max()))
    assert right[0] > 0.9
    assert moved[1] < 1e-3 < moved[0]


@pytest.fixture(scope="module")
def parts() -> list[marked_painting.MarkedPart]:
    """Return the parts of a painting whose twelve largest strokes are marked."""
    painting = bristles(SIZE, 2)
    labels = painting.labels.astype(np.int32)
    largest = np.argsort(-np.bincount(labels[labels >= 0]))[:12]
    outlines = outlines_of(labels, int(labels.max()) + 1)
    marks = [Mark(f"{k}", outlines[k][:1], np.ones(1), (outlines[k],)) for k in largest]
    return segment_marked_parts(shipped(), picture_of(painting), marks_of(*marks), 1.0)


def test_judges_are_fitted_in_a_copy_and_agree_more_with_the_marks(parts):
    model = copy.deepcopy(shipped())
    with torch.no_grad():
        model.pairs.layers[-1].bias -= 6  # merges almost nothing
    before = {name: value.clone() for name, value in model.state_dict().items()}
    fitted = fit_to(model, parts, 0)
    assert agreement_with(parts, fitted.classifiers()) > agreement_with(parts, model.classifiers()) + 0.05
    changed = {name for name, value in fitted.state_dict().items() if not torch.equal(value, before[name])}
    assert {name.partition(".")[0] for name in changed} == {"pairs", "nodes"}
    assert all(torch.equal(value, before[name]) for name, value in model.state_dict().items())


@pytest.mark.parametrize("gain", [0.1, -0.1])
def test_judges_are_kept_if_they_find_more_of_the_marks_that_they_have_not_seen(gain, parts, monkeypatch):
    taught = RecoveryModel()
    monkeypatch.setattr(marked_painting, "segment_marked_parts", lambda *_: parts)
    monkeypatch.setattr(marked_painting, "fit_to", lambda *_: taught)
    bias = taught.pairs.layers[-1].bias.item()

    def agreement(some, classifiers):
        labels = np.unique(some[0].segmented.labels)
        assert len({*(labels[labels >= 0] % 2)}) == 1, "only marks of one half are used"
        return gain if float(classifiers.pairs.layers[-1][-1, 0]) == pytest.approx(bias) else 0.0

    monkeypatch.setattr(marked_painting, "agreement_with", agreement)
    assert (fit_judges(shipped(), None, None, 1.0, 0) is taught) == (gain > 0)


def test_later_marks_lie_on_top():
    labels = label_image([level(10), level(12)], SIZE)
    assert labels[14, 50] == 1
    assert labels[7, 50] == 0
    assert labels[40, 50] == -1
