"""What is seen where strokes meet says which lies above, and what else is known of a region, whether it is a stroke."""

from dataclasses import replace

import numpy as np
import pytest
from brushexp_recovery.calibration import DOUBT, signs_of
from brushexp_recovery.curves import Fitted
from brushexp_recovery.finding import OVER_UNIT, Regions
from brushexp_recovery.model import CONFIDENCE_FEATURES, ORDER_FEATURES
from brushexp_recovery.network import OVER
from brushexp_recovery.stacking import meetings_of, stack

EVIDENCE, SOFT, CROSSING = 0, 1, 2


@pytest.fixture
def crossed():
    """A level stroke below one that falls, and one apart; the network says nothing of order."""
    labels = np.full((60, 80), -1, np.int32)
    labels[24:36, 10:70], labels[5:55, 34:46], labels[50:58, 2:20] = 0, 1, 2
    told = np.array([[40, 30, 1, 0, np.log(12), np.log(60), 0.8], [40, 30, -1, 0, np.log(12), np.log(50), 1.0]])
    told = np.concatenate([told, [[11, 54, 1, 0, np.log(8), np.log(18), 1.0]]])
    over = np.random.default_rng(0).integers(-30, 30, (len(OVER), 60, 80)).astype(np.int8)
    regions = Regions(labels, np.array([0.9, 0.8, 0.5]), told, over, 1.0)
    curve = np.array([[[16, 30], [40, 30], [64, 30]], [[40, 11], [40, 30], [40, 49]], [[6, 54], [11, 54], [16, 54]]])
    return regions, Fitted(curve.astype(float), np.array([12.0, 12, 8]), np.zeros((3, 3)))


def test_evidence_is_that_of_a_slow_loop(crossed):
    pairs, features = meetings_of(*crossed)
    labels, over = crossed[0].labels, crossed[0].over
    said = []
    for channel, (dy, dx) in enumerate(OVER):
        for y in range(60 - dy):
            for x in range(max(0, -dx), 80 - max(0, dx)):
                here, there = labels[y, x], labels[y + dy, x + dx]
                if {here, there} == {0, 1}:
                    said.append((1 if here < there else -1) * over[channel, y, x] / OVER_UNIT)
    assert pairs.tolist() == [[0, 1]]
    assert features.shape == (1, ORDER_FEATURES)
    assert features[0, EVIDENCE] == pytest.approx(np.mean(said) * np.sqrt(len(said)))
    assert features[0, SOFT] == pytest.approx(np.tanh(np.array(said) / 2).mean())


def test_a_stroke_that_is_seen_where_two_cross_lies_above(crossed):
    _, features = meetings_of(*crossed)
    assert features[0, CROSSING] > 0.9  # all of 12 x 12 pixels
    assert features[0, CROSSING + 1] == pytest.approx(12 * features[0, CROSSING], rel=0.05)


def test_what_speaks_for_one_of_two_speaks_against_the_other(crossed):
    regions, fitted = crossed
    turned = np.array([1, 0, 2])
    labels = np.where(regions.labels >= 0, turned[regions.labels], -1).astype(np.int32)
    other = replace(regions, labels=labels, chance=regions.chance[turned], told=regions.told[turned])
    one, two = meetings_of(regions, fitted), meetings_of(other, Fitted(*(part[turned] for part in fitted)))
    np.testing.assert_array_equal(one[0], two[0])
    np.testing.assert_allclose(one[1], -two[1], atol=1e-9)


def test_regions_that_do_not_meet_have_any_order(crossed):
    regions, fitted = crossed
    alone = replace(regions, labels=np.where(regions.labels == 0, -1, regions.labels))
    pairs, features = meetings_of(alone, fitted)
    assert len(pairs) == len(features) == 0
    assert sorted(stack(3, pairs, features @ np.ones(ORDER_FEATURES))) == [0, 1, 2]


def test_signs_say_how_sure_the_judge_is_and_what_is_seen_of_a_region(crossed):
    regions = replace(crossed[0], chance=np.array([0.0, 0.5, 1.0]))
    signs = signs_of(regions)
    assert signs.shape == (3, CONFIDENCE_FEATURES)
    np.testing.assert_allclose(1 / (1 + np.exp(-signs[:, 0])), [DOUBT, 0.5, 1 - DOUBT])
    np.testing.assert_allclose(signs[:, 1], regions.told[:, 6])
    np.testing.assert_allclose(signs[2, 2], 0, atol=1e-9)  # 8 x 18 pixels are as many as its sides promise
    empty = replace(regions, labels=np.full((9, 9), -1, np.int32), chance=np.empty(0), told=np.empty((0, 7)))
    assert signs_of(empty).shape == (0, CONFIDENCE_FEATURES)
