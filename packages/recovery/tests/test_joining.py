"""Regions are joined as an obvious loop joins them, and the best of what was made is taken."""

from itertools import chain, combinations

import numpy as np
import pytest
import torch
from brushexp_recovery.joining import LARGEST
from brushexp_recovery.judges import Asked, Judge
from brushexp_recovery.merging import PAIR_FEATURES, describe, pair_features
from brushexp_recovery.regions import GROUPS, SUMS, Pieces
from brushexp_recovery.tree import Tree, cut, grow


def some_pieces(seed: int, side: int = 5) -> Pieces:
    """A grid of pieces whose opinions and affinities are drawn."""
    random = np.random.default_rng(seed)
    count = side * side
    area = random.integers(5, 40, count)[:, None]
    centre = np.stack([np.arange(count) % side, np.arange(count) // side], 1) * 5.0 + random.random((count, 2))
    spread = random.random((count, 2)) + 1
    around = centre**2 + spread
    mean = np.concatenate([
        np.ones((count, 1)), centre, around[:, :1], centre.prod(1)[:, None], around[:, 1:],
        lab := random.random((count, 3)) * 50, lab**2 + 4, far := centre + random.normal(size=(count, 2)),
        (far**2).sum(1)[:, None] + 3, random.normal(size=(count, 2)), sizes := random.normal(size=(count, 2)) + 2,
        random.random((count, 2)), sizes**2 + 0.1,
    ], 1)  # fmt: skip
    pairs = np.array([
        (i, j) for i, j in combinations(range(count), 2) if abs(centre[i] - centre[j]).max() < 7 or i % 9 == j % 7
    ])  # fmt: skip
    number = random.integers(1, 9, (len(pairs), GROUPS)).astype(float)
    between = np.concatenate([number * random.random((len(pairs), GROUPS)), number], 1)
    return Pieces(np.zeros((1, 1), int), mean * area, random.random((count, 2 * GROUPS)), pairs, between)


def some_judge(seed: int) -> Asked:
    torch.manual_seed(seed)
    judge = Judge(PAIR_FEATURES)
    judge.scale.mul_(2)
    return judge.asked()


def joined(pieces: Pieces, judge: Asked | None, least: float) -> list[tuple[frozenset[int], float]]:
    """Join regions as sets of pieces, looking at all pairs again each time: what is made, and at which chance."""
    weight = np.array([4, 2, 1, 1])
    regions, closed = [frozenset([k]) for k in range(len(pieces.sums))], set[frozenset[int]]()
    made = []
    while True:
        best = (least, None)
        for one, other in combinations(regions, 2):
            crossing = np.isin(pieces.pairs, list(one)) @ [1, 0] * (np.isin(pieces.pairs, list(other)) @ [0, 1])
            crossing = crossing + np.isin(pieces.pairs, list(other)) @ [1, 0] * (
                np.isin(pieces.pairs, list(one)) @ [0, 1]
            )
            between = pieces.between[crossing > 0].sum(0)
            if not between.any() or closed & {one, other}:
                continue
            sums = np.stack([pieces.sums[list(region)].sum(0) for region in (one, other)])
            row = pair_features(sums, np.array([[0, 1]]), between[None])
            number = weight * between[GROUPS:]
            chance = (row[0, :GROUPS] * number).sum() / number.sum() if judge is None else judge(row)[0, 0]
            if chance > best[0]:
                best = (chance, (one, other))
        if best[1] is None:
            return made
        new = best[1][0] | best[1][1]
        regions = [region for region in regions if region not in best[1]] + [new]
        made.append((new, best[0]))
        sums = pieces.sums[list(new)].sum(0)
        if sums[0] > LARGEST * np.exp(sums[17:19].sum() / sums[0]):
            closed.add(new)


@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.parametrize("by", ["judge", "affinity"])
def test_regions_are_joined_as_by_an_obvious_loop(seed, by):
    pieces, judge, least = some_pieces(seed), some_judge(seed) if by == "judge" else None, 0.4
    tree, expected = grow(pieces, judge, least), joined(pieces, judge, least)
    nodes = [frozenset([k]) for k in range(tree.pieces)]
    for i, j in tree.children.tolist():
        nodes.append(nodes[i] | nodes[j])
    assert len(expected) > 10
    assert nodes[tree.pieces :] == [new for new, _ in expected]
    np.testing.assert_allclose(tree.made[tree.pieces :], [chance for _, chance in expected], rtol=1e-5)
    for node, inside in enumerate(nodes):
        held = np.isin(pieces.pairs, list(inside))
        within = pieces.within[list(inside)].sum(0) + pieces.between[held.all(1)].sum(0)
        np.testing.assert_allclose(tree.sums[node], pieces.sums[list(inside)].sum(0))
        np.testing.assert_allclose(tree.within[node], within)
        np.testing.assert_allclose(tree.around[node], pieces.between[held.any(1) & ~held.all(1)].sum(0), atol=1e-9)


def test_shapes_are_those_of_rectangles():
    random = np.random.default_rng(2)
    angle, (x, y) = 0.6, random.uniform(-0.5, 0.5, (2, 40000)) * [[30], [8]]
    u, v = x * np.cos(angle) - y * np.sin(angle) + 50, x * np.sin(angle) + y * np.cos(angle) + 20
    sums = np.zeros((1, SUMS))
    sums[0, :6] = [len(u), u.sum(), v.sum(), (u * u).sum(), (u * v).sum(), (v * v).sum()]
    sums[0, 15:17] = len(u) * np.array([np.cos(2 * angle), np.sin(2 * angle)])
    one = describe(sums)
    assert one.length[0] == pytest.approx(30, rel=0.02)
    assert one.width[0] == pytest.approx(8, rel=0.02)
    assert one.along[0] == pytest.approx(1, abs=0.01)


def test_features_of_a_pair_do_not_depend_on_its_order_and_are_finite():
    pieces = some_pieces(3)
    areas = pieces.sums[pieces.pairs, 0]
    differ = areas[:, 0] != areas[:, 1]  # the smaller one comes first
    pairs, between = pieces.pairs[differ], pieces.between[differ]
    features = pair_features(pieces.sums, pairs, between)
    np.testing.assert_array_equal(features, pair_features(pieces.sums, pairs[:, ::-1].copy(), between))
    nothing = np.zeros((2, SUMS))
    nothing[:, 0] = 1
    nothing[:, 17:19] = [[1e4, 1e4], [-1e4, 0]]  # exponentials overflow
    assert np.isfinite(pair_features(nothing, np.array([[0, 1]]), np.zeros((1, 2 * GROUPS)))).all()


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
        zeros = np.zeros((len(leaves), 8))
        tree = Tree(np.array(children, int).reshape(-1, 2), zeros, zeros, zeros, zeros[:, 0], zeros[:, 0])
        chosen = cut(tree, value)
        assert sum(value[k] for k in set(chosen.tolist()) - {-1}) == pytest.approx(best)
        assert all(k in leaves[node] for k, node in enumerate(chosen) if node >= 0)
