"""Test that several looks at a part of a picture vote on regions, and that the most certain regions are kept."""

from typing import Any

import numpy as np
import pytest
from brushexp_recovery.find.agreement import agreement_of, attributes_of, find_candidates
from brushexp_recovery.find.look import Look
from brushexp_recovery.find.suppression import Candidate, keep_surest
from brushexp_recovery.join.merge_tree import MergeTree
from brushexp_recovery.model.channels import StrokeAttribute
from brushexp_recovery.raster.boxes import Box
from brushexp_recovery.raster.resampling import nearest_pixels
from brushexp_recovery.raster.tiles import Tile
from brushexp_recovery.segment.moments import Moment
from brushexp_recovery.segment.region_adjacency import AffinityColumn

Array = np.ndarray[Any, Any]
BOX, EVERYWHERE = Box(10, 34, 5, 45), Box(0, 100, 0, 100)


def some_look(size: tuple[int, int], random: np.random.Generator) -> Look:
    """Make a look with 12 randomly placed superpixels, random merges, and three random nodes as chosen regions."""
    superpixels = random.integers(12, size=(-(-size[0] // 4), -(-size[1] // 4))).repeat(4, 0).repeat(4, 1)
    superpixels = superpixels[: size[0], : size[1]].astype(np.int32)
    free, children = list(range(12)), []
    for node in range(12, 19):
        i, j = (free.pop(int(random.integers(len(free)))) for _ in range(2))
        children.append((i, j))
        free.append(node)
    moments, rest = random.random((19, len(Moment))) + 1, np.zeros((19, len(AffinityColumn)))
    tree = MergeTree(np.array(children), moments, rest, rest, np.ones(19), np.ones(19))
    nodes = np.sort(random.choice(free, 3, replace=False))
    regions = np.full(size, -1, np.int32)
    for place, node in enumerate(nodes):
        regions[covered(superpixels, tree, node)] = place
    return Look(superpixels, tree, random.random(19), nodes, regions)


def covered(superpixels: Array, tree: MergeTree, node: int) -> Array:
    """Return a mask of the pixels that a node of a tree covers."""
    if node < tree.leaves:
        return superpixels == node
    one, other = tree.children[node - tree.leaves]
    return covered(superpixels, tree, one) | covered(superpixels, tree, other)


def at_first(values: Array, looks: list[Look]) -> Array:
    """Resample the pixels of a look to the pixel grid of the first look."""
    height, width = looks[0].superpixels.shape
    rows, columns = nearest_pixels(height, values.shape[0]), nearest_pixels(width, values.shape[1])
    return values[rows[:, None], columns]


@pytest.mark.parametrize("seed", range(3))
def test_looks_agree_as_far_as_the_best_of_their_regions_do(seed):
    random = np.random.default_rng(seed)
    looks = [some_look(size, random) for size in ((24, 40), (34, 56), (17, 28))]
    for one, votes in zip(looks, agreement_of(looks), strict=True):
        for place, node in enumerate(one.nodes):
            region = at_first(covered(one.superpixels, one.tree, node), looks)
            best = []
            for other in looks:
                nodes = [at_first(covered(other.superpixels, other.tree, k), looks) for k in range(19)]
                iou = np.array([(region & there).sum() / (region | there).sum() for there in nodes])
                best.append((iou * other.worth).max())
            assert votes[place] == pytest.approx(np.mean(best))


def test_regions_belong_to_the_core_in_which_their_middle_lies():
    looks = [some_look((24, 40), np.random.default_rng(1))]
    whole = find_candidates(looks, Tile(BOX, EVERYWHERE))
    assert len(whole) == 3
    for one in whole:
        place = looks[0].regions.ravel()[one.pixels]
        assert (place == place[0]).all()
        assert (looks[0].regions == place[0]).sum() == len(one.pixels)
    cores = (Box(0, 100, 0, 25), Box(0, 100, 25, 100))
    halves = [find_candidates(looks, Tile(BOX, core)) for core in cores]
    assert sorted(one.chance for half in halves for one in half) == sorted(one.chance for one in whole)


def test_attributes_of_regions_are_in_pixels_of_the_picture():
    moments = np.zeros((1, len(Moment)))
    moments[0, Moment.AREA] = 10
    moments[0, [Moment.CENTRE_X, Moment.CENTRE_Y]] = 10 * np.array([40, 60])
    moments[0, [Moment.COSINE, Moment.SINE, Moment.VISIBLE]] = 6, -8, 7
    moments[0, [Moment.LOG_WIDTH, Moment.LOG_LENGTH]] = 10 * np.log([8, 30])
    (row,) = attributes_of(moments, np.array([2.0, 2.0]), BOX)
    expected = {
        StrokeAttribute.CENTRE_X: 25,
        StrokeAttribute.CENTRE_Y: 40,
        StrokeAttribute.COSINE: 0.6,
        StrokeAttribute.SINE: -0.8,
        StrokeAttribute.LOG_WIDTH: np.log(4),
        StrokeAttribute.LOG_LENGTH: np.log(15),
        StrokeAttribute.VISIBLE: 0.7,
    }
    assert row == pytest.approx([expected[attribute] for attribute in StrokeAttribute])


def kept(candidates: list[tuple[range, float]], labels: Array, least_share: float = 0.0) -> list[float]:
    """Return the chances of the accepted regions, in order of acceptance."""
    made = [Candidate(np.array(pixels), chance, np.zeros(len(StrokeAttribute))) for pixels, chance in candidates]
    return [one.chance for one in keep_surest(made, labels, least_share)]


def test_the_surest_region_is_kept_first_and_small_rests_are_dropped():
    labels = np.full(50, -1, np.int32)
    regions = [(range(0, 10), 0.5), (range(5, 15), 0.9), (range(9, 30), 0.7), (range(40, 44), 0.2)]
    assert kept(regions, labels) == [0.9, 0.7, 0.2]  # half of the first is taken
    np.testing.assert_array_equal(np.bincount(labels + 1), [50 - 29, 10, 15, 4])


@pytest.mark.parametrize(("last", "count"), [(0.36, 4), (0.34, 3)])
def test_nothing_is_kept_that_is_less_sure_than_a_share_of_the_mean(last, count):
    regions = [(range(10 * k, 10 * k + 10), chance) for k, chance in enumerate((0.5, 0.9, last, 0.7))]
    assert len(kept(regions, np.full(50, -1, np.int32), 0.5)) == count
