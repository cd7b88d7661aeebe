"""Test that merging agrees with a straightforward implementation, and that the best cut of a tree is found."""

from itertools import chain, combinations

import numpy as np
import pytest
import torch
from brushexp_recovery.join.merge_loop import LARGEST_REGION
from brushexp_recovery.join.merge_tree import MergeTree, grow_tree
from brushexp_recovery.join.node_features import node_features
from brushexp_recovery.join.pair_features import pair_features
from brushexp_recovery.join.shape import shapes_of
from brushexp_recovery.join.tree_cut import best_cut
from brushexp_recovery.model.features import NodeFeature, PairFeature
from brushexp_recovery.model.perceptron import Perceptron, PerceptronWeights
from brushexp_recovery.segment.moments import Moment
from brushexp_recovery.segment.region_adjacency import DISTANCE_GROUPS, PAIRS, SUMS, AffinityColumn
from brushexp_recovery.segment.superpixels import Superpixels

AFFINITIES = slice(PairFeature.AFFINITY_ADJACENT, PairFeature.AFFINITY_20 + 1)


def some_superpixels(seed: int, side: int = 5) -> Superpixels:
    """Make a grid of superpixels with random moments and affinities."""
    random = np.random.default_rng(seed)
    count = side * side
    area = random.integers(5, 40, count)
    x, y = (np.stack([np.arange(count) % side, np.arange(count) // side]) * 5.0) + random.random((2, count))
    lab, log_size = random.random((3, count)) * 50, random.normal(size=(2, count)) + 2
    centre_x, centre_y = x + random.normal(size=count), y + random.normal(size=count)
    cosine, sine = random.normal(size=(2, count))
    mean = np.empty((count, len(Moment)))
    mean[:, Moment.AREA] = 1
    mean[:, [Moment.X, Moment.Y]] = np.stack([x, y], 1)
    mean[:, [Moment.XX, Moment.YY]] = np.stack([x**2, y**2], 1) + random.random((count, 2)) + 1
    mean[:, Moment.XY] = x * y
    mean[:, [Moment.LIGHTNESS, Moment.A, Moment.B]] = lab.T
    mean[:, [Moment.LIGHTNESS_SQUARED, Moment.A_SQUARED, Moment.B_SQUARED]] = lab.T**2 + 4
    mean[:, [Moment.CENTRE_X, Moment.CENTRE_Y]] = np.stack([centre_x, centre_y], 1)
    mean[:, Moment.CENTRE_SQUARED] = centre_x**2 + centre_y**2 + 3
    mean[:, [Moment.COSINE, Moment.SINE]] = np.stack([cosine, sine], 1)
    mean[:, [Moment.LOG_WIDTH, Moment.LOG_LENGTH]] = log_size.T
    mean[:, [Moment.VISIBLE, Moment.PAINT]] = random.random((count, 2))
    mean[:, [Moment.LOG_WIDTH_SQUARED, Moment.LOG_LENGTH_SQUARED]] = log_size.T**2 + 0.1
    is_near = lambda i, j: max(abs(x[i] - x[j]), abs(y[i] - y[j])) < 7 or i % 9 == j % 7  # noqa: E731
    pairs = np.array([(i, j) for i, j in combinations(range(count), 2) if is_near(i, j)])
    number = random.integers(1, 9, (len(pairs), DISTANCE_GROUPS)).astype(float)
    between = np.concatenate([number * random.random((len(pairs), DISTANCE_GROUPS)), number], 1)
    within = random.random((count, len(AffinityColumn)))
    return Superpixels(np.zeros((1, 1), int), mean * area[:, None], within, pairs, between)


def some_perceptron(seed: int) -> PerceptronWeights:
    torch.manual_seed(seed)
    perceptron = Perceptron(len(PairFeature))
    perceptron.scale.mul_(2)
    return perceptron.weights()


def mean_affinity(row: np.ndarray, between: np.ndarray) -> float:
    """Compute the mean affinity of a pair from its features, with the most weight on the nearest pixels."""
    number = np.array([4, 2, 1, 1]) * between[PAIRS]
    return (row[AFFINITIES] * number).sum() / number.sum()


def merged_slowly(
    superpixels: Superpixels, perceptron: PerceptronWeights | None, least: float
) -> list[tuple[frozenset[int], float]]:
    """Merge sets of superpixels, re-examining all pairs after each merge; return the merged sets and their chances."""
    regions, closed = [frozenset([k]) for k in range(len(superpixels.moments))], set[frozenset[int]]()
    made = []
    while True:
        best = (least, None)
        for one, other in combinations(regions, 2):
            first, second = superpixels.pairs.T
            crosses = np.isin(first, list(one)) & np.isin(second, list(other))
            crosses |= np.isin(first, list(other)) & np.isin(second, list(one))
            between = superpixels.between[crosses].sum(0)
            if not between.any() or closed & {one, other}:
                continue
            moments = np.stack([superpixels.moments[list(region)].sum(0) for region in (one, other)])
            row = pair_features(moments, np.array([[0, 1]]), between[None])
            chance = mean_affinity(row[0], between) if perceptron is None else perceptron(row)[0, 0]
            if chance > best[0]:
                best = (chance, (one, other))
        if best[1] is None:
            return made
        new = best[1][0] | best[1][1]
        regions = [region for region in regions if region not in best[1]] + [new]
        made.append((new, best[0]))
        moments = superpixels.moments[list(new)].sum(0)
        stroke_area = np.exp((moments[Moment.LOG_WIDTH] + moments[Moment.LOG_LENGTH]) / moments[Moment.AREA])
        if moments[Moment.AREA] > LARGEST_REGION * stroke_area:
            closed.add(new)


@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.parametrize("by", ["perceptron", "affinity"])
def test_regions_are_merged_as_by_an_obvious_loop(seed, by):
    superpixels, least = some_superpixels(seed), 0.4
    perceptron = some_perceptron(seed) if by == "perceptron" else None
    tree, expected = grow_tree(superpixels, perceptron, least), merged_slowly(superpixels, perceptron, least)
    nodes = [frozenset([k]) for k in range(tree.leaves)]
    for i, j in tree.children.tolist():
        nodes.append(nodes[i] | nodes[j])
    assert len(expected) > 10
    assert nodes[tree.leaves :] == [new for new, _ in expected]
    np.testing.assert_allclose(tree.merge_chance[tree.leaves :], [chance for _, chance in expected], rtol=1e-5)
    for node, inside in enumerate(nodes):
        held = np.isin(superpixels.pairs, list(inside))
        within = superpixels.within[list(inside)].sum(0) + superpixels.between[held.all(1)].sum(0)
        around = superpixels.between[held.any(1) & ~held.all(1)].sum(0)
        np.testing.assert_allclose(tree.moments[node], superpixels.moments[list(inside)].sum(0))
        np.testing.assert_allclose(tree.within[node], within)
        np.testing.assert_allclose(tree.around[node], around, atol=1e-9)


def test_shapes_are_those_of_rectangles():
    random = np.random.default_rng(2)
    angle, (x, y) = 0.6, random.uniform(-0.5, 0.5, (2, 40000)) * [[30], [8]]
    u, v = x * np.cos(angle) - y * np.sin(angle) + 50, x * np.sin(angle) + y * np.cos(angle) + 20
    moments = np.zeros((1, len(Moment)))
    moments[0, Moment.AREA] = len(u)
    moments[0, [Moment.X, Moment.Y]] = u.sum(), v.sum()
    moments[0, [Moment.XX, Moment.XY, Moment.YY]] = (u * u).sum(), (u * v).sum(), (v * v).sum()
    moments[0, [Moment.COSINE, Moment.SINE]] = len(u) * np.array([np.cos(2 * angle), np.sin(2 * angle)])
    shapes = shapes_of(moments)
    assert shapes.length[0] == pytest.approx(30, rel=0.02)
    assert shapes.width[0] == pytest.approx(8, rel=0.02)
    assert shapes.alignment[0] == pytest.approx(1, abs=0.01)


def test_features_of_a_pair_do_not_depend_on_its_order_and_are_finite():
    superpixels = some_superpixels(3)
    areas = superpixels.moments[superpixels.pairs, Moment.AREA]
    differ = areas[:, 0] != areas[:, 1]  # the smaller one comes first
    pairs, between = superpixels.pairs[differ], superpixels.between[differ]
    features = pair_features(superpixels.moments, pairs, between)
    turned = pair_features(superpixels.moments, pairs[:, ::-1].copy(), between)
    np.testing.assert_array_equal(features, turned)
    nothing = np.zeros((2, len(Moment)))
    nothing[:, Moment.AREA] = 1
    nothing[:, [Moment.LOG_WIDTH, Moment.LOG_LENGTH]] = [[1e4, 1e4], [-1e4, 0]]  # exponentials overflow
    none = np.zeros((1, len(AffinityColumn)))
    assert np.isfinite(pair_features(nothing, np.array([[0, 1]]), none)).all()


def test_features_of_a_pair_say_what_their_names_say():
    superpixels = some_superpixels(4)
    (i, j), between = superpixels.pairs[7], superpixels.between[7]
    small, large = sorted((superpixels.moments[i], superpixels.moments[j]), key=lambda one: one[Moment.AREA])
    a, b = small / small[Moment.AREA], large / large[Moment.AREA]
    both = (small + large) / (small + large)[Moment.AREA]
    (row,) = pair_features(superpixels.moments, np.array([[i, j]]), between[None])
    shapes = shapes_of(np.stack([small, large, small + large]))
    expected = {
        PairFeature.AFFINITY_8: (between[AffinityColumn.SUM_8] + 0.25) / (between[AffinityColumn.PAIRS_8] + 0.5),
        PairFeature.LOG_PAIRS_3: np.log(between[AffinityColumn.PAIRS_3] + 1),
        PairFeature.AFFINITY: (between[SUMS].sum() + 0.25) / (between[PAIRS].sum() + 0.5),
        PairFeature.LOG_AREA_LARGE: np.log(large[Moment.AREA]),
        PairFeature.B_GAP: abs(a[Moment.B] - b[Moment.B]),
        PairFeature.LOG_SPREAD_SMALL: np.log(shapes.spread[0]) - both[Moment.LOG_WIDTH],
        PairFeature.ALIGNMENT_BOTH: shapes.alignment[2],
        PairFeature.WIDTH_GAP: abs(a[Moment.LOG_WIDTH] - b[Moment.LOG_WIDTH]),
        PairFeature.VISIBLE: both[Moment.VISIBLE],
        PairFeature.LOG_LENGTH_GAIN: np.log(shapes.length[2] / shapes.length[1]),
        PairFeature.LOG_COMPACTNESS_LARGE: np.log(large[Moment.AREA] / (shapes.length[1] * shapes.width[1])),
        PairFeature.PAINT_SMALL: a[Moment.PAINT],
        PairFeature.LOG_PREDICTED_WIDTH: both[Moment.LOG_WIDTH],
    }
    for feature, value in expected.items():
        assert row[feature] == pytest.approx(value, rel=1e-5), feature.name


def test_features_of_a_node_say_what_their_names_say():
    superpixels = some_superpixels(5)
    tree = grow_tree(superpixels, None, 0.4)
    node = len(tree.moments) - 1
    row, shapes = node_features(tree)[node], shapes_of(tree.moments[[node]])
    mean, area = tree.moments[node] / tree.moments[node, Moment.AREA], tree.moments[node, Moment.AREA]
    within, around = tree.within[node], tree.around[node]
    inside = (within[AffinityColumn.SUM_20] + 0.5) / (within[AffinityColumn.PAIRS_20] + 1)
    expected = {
        NodeFeature.LOG_AREA: np.log(area),
        NodeFeature.AFFINITY_INSIDE_20: inside,
        NodeFeature.MERGE_CHANCE: tree.merge_chance[node],
        NodeFeature.LOG_B_SPREAD: 0.5 * np.log(mean[Moment.B_SQUARED] - mean[Moment.B] ** 2),
        NodeFeature.ALIGNMENT: shapes.alignment[0],
        NodeFeature.LOG_ELONGATION: np.log(shapes.length[0] / shapes.width[0]),
        NodeFeature.LOG_PREDICTED_LENGTH: mean[Moment.LOG_LENGTH],
        NodeFeature.PAINT: mean[Moment.PAINT],
        NodeFeature.LOG_CONTACT_20: np.log((around[AffinityColumn.PAIRS_20] + 1) / area),
    }
    for feature, value in expected.items():
        assert row[feature] == pytest.approx(value, rel=1e-4), feature.name


def test_the_cut_of_a_tree_is_the_best_of_all():
    random = np.random.default_rng(3)
    for _ in range(20):
        roots, children = list(range(5)), []
        while len(roots) > 1 and random.random() < 0.9:
            i, j = random.choice(len(roots), 2, replace=False)
            children.append((roots[i], roots[j]))
            roots = [root for k, root in enumerate(roots) if k not in (i, j)] + [4 + len(children)]
        leaves = {k: {k} for k in range(5)}
        for k, (i, j) in enumerate(children):
            leaves[5 + k] = leaves[i] | leaves[j]
        value = random.normal(size=len(leaves))
        sets = chain.from_iterable(combinations(leaves, k) for k in range(6))
        apart = (s for s in sets if sum(len(leaves[k]) for k in s) == len(set().union(*(leaves[k] for k in s))))
        best = max(sum(value[k] for k in s) for s in apart)
        zeros = np.zeros((len(leaves), len(Moment)))
        tree = MergeTree(np.array(children, int).reshape(-1, 2), zeros, zeros, zeros, zeros[:, 0], zeros[:, 0])
        chosen = best_cut(tree, value)
        assert sum(value[k] for k in set(chosen.tolist()) - {-1}) == pytest.approx(best)
        assert all(k in leaves[node] for k, node in enumerate(chosen) if node >= 0)
