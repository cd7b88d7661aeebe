"""Several looks at one part of a picture agree on regions, and the surest ones are laid."""

from typing import Any

import numpy as np
import pytest
from brushexp_recovery.looking import Candidate, Look, agreed, lay, regions_in
from brushexp_recovery.raster.resampling import nearest_pixels
from brushexp_recovery.raster.tiles import Box
from brushexp_recovery.regions import GROUPS, SUMS
from brushexp_recovery.tree import Tree

Array = np.ndarray[Any, Any]


def look(size: tuple[int, int], random: np.random.Generator) -> Look:
    """Show 12 pieces in random places, joined at random, and some disjoint nodes that are chosen."""
    pieces = random.integers(12, size=(-(-size[0] // 4), -(-size[1] // 4))).repeat(4, 0).repeat(4, 1)
    pieces = pieces[: size[0], : size[1]].astype(np.int32)
    free, children = list(range(12)), []
    for node in range(12, 19):
        i, j = (free.pop(int(random.integers(len(free)))) for _ in range(2))
        children.append((i, j))
        free.append(node)
    sums, rest = random.random((19, SUMS)) + 1, np.zeros((19, 2 * GROUPS))
    tree = Tree(np.array(children), sums, rest, rest, np.ones(19), np.ones(19))
    nodes = np.sort(random.choice(free, 3, replace=False))
    number = np.full(size, -1, np.int32)
    for place, node in enumerate(nodes):
        number[covered(pieces, tree, node)] = place
    return Look(pieces, tree, random.random(19), nodes, number)


def covered(pieces: Array, tree: Tree, node: int) -> Array:
    """Tell which pixels a node of a tree covers."""
    if node < tree.pieces:
        return pieces == node
    one, other = tree.children[node - tree.pieces]
    return covered(pieces, tree, one) | covered(pieces, tree, other)


def at_first(values: Array, looks: list[Look]) -> Array:
    """Show the pixels of a look at those of the first one."""
    height, width = looks[0].pieces.shape
    return values[nearest_pixels(height, values.shape[0])[:, None], nearest_pixels(width, values.shape[1])]


@pytest.mark.parametrize("seed", range(3))
def test_looks_agree_as_far_as_the_best_of_their_regions_do(seed):
    random = np.random.default_rng(seed)
    looks = [look(size, random) for size in ((24, 40), (34, 56), (17, 28))]
    for one, votes in zip(looks, agreed(looks), strict=True):
        for place, node in enumerate(one.nodes):
            region = at_first(covered(one.pieces, one.tree, node), looks)
            best = []
            for other in looks:
                nodes = [at_first(covered(other.pieces, other.tree, k), looks) for k in range(19)]
                iou = np.array([(region & there).sum() / (region | there).sum() for there in nodes])
                best.append((iou * other.worth).max())
            assert votes[place] == pytest.approx(np.mean(best))


def test_regions_belong_to_the_core_in_which_their_middle_lies():
    looks = [look((24, 40), np.random.default_rng(1))]
    whole = regions_in(looks, Box(10, 34, 5, 45), Box(0, 100, 0, 100))
    assert len(whole) == 3
    for one in whole:
        place = looks[0].number.ravel()[one.pixels]
        assert (place == place[0]).all()
        assert (looks[0].number == place[0]).sum() == len(one.pixels)
    halves = [regions_in(looks, Box(10, 34, 5, 45), core) for core in (Box(0, 100, 0, 25), Box(0, 100, 25, 100))]
    assert sorted(one.chance for half in halves for one in half) == sorted(one.chance for one in whole)


def laid(candidates: list[tuple[range, float]], labels: Array, share: float = 0.0) -> list[float]:
    """Chances of the regions that are laid, in their order."""
    made = [Candidate(np.array(pixels), chance, np.zeros(7)) for pixels, chance in candidates]
    return [one.chance for one in lay(made, labels, share)]


def test_the_surest_region_is_laid_first_and_little_rests_are_dropped():
    labels = np.full(50, -1, np.int32)
    regions = [(range(0, 10), 0.5), (range(5, 15), 0.9), (range(9, 30), 0.7), (range(40, 44), 0.2)]
    assert laid(regions, labels) == [0.9, 0.7, 0.2]  # half of the first is taken
    np.testing.assert_array_equal(np.bincount(labels + 1), [50 - 29, 10, 15, 4])


@pytest.mark.parametrize(("last", "kept"), [(0.36, 4), (0.34, 3)])
def test_nothing_is_laid_that_is_less_sure_than_a_share_of_the_mean(last, kept):
    regions = [(range(10 * k, 10 * k + 10), chance) for k, chance in enumerate((0.5, 0.9, last, 0.7))]
    assert len(laid(regions, np.full(50, -1, np.int32), 0.5)) == kept
