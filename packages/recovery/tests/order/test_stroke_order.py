"""Test that the order of strokes is inferred from the pixels where they meet."""

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from brushexp_recovery.curves.fit import StrokeCurves
from brushexp_recovery.find.regions import OCCLUSION_STEPS, Regions
from brushexp_recovery.model.channels import OCCLUSION_OFFSETS
from brushexp_recovery.model.features import OrderFeature
from brushexp_recovery.order.evidence import find_meetings
from brushexp_recovery.order.ranking import rank_strokes
from recovery_regions import crossed_regions
from recovery_scenes import straight


@pytest.fixture
def crossed() -> tuple[Regions, StrokeCurves]:
    """Make a horizontal stroke, a vertical stroke above it and a separate one, without predicted occlusion."""
    curve = straight(((16, 30), (64, 30)), ((40, 11), (40, 49)), ((6, 54), (16, 54)))
    return crossed_regions(), StrokeCurves(curve, np.array([12.0, 12, 8]), np.zeros((3, 3)))


def test_evidence_is_that_of_a_slow_loop(crossed):
    meetings = find_meetings(*crossed)
    labels, occlusion = crossed[0].labels, crossed[0].occlusion
    log_odds = []
    for channel, (dy, dx) in enumerate(OCCLUSION_OFFSETS):
        for y in range(60 - dy):
            for x in range(max(0, -dx), 80 - max(0, dx)):
                here, there = labels[y, x], labels[y + dy, x + dx]
                if {here, there} == {0, 1}:
                    log_odds.append((1 if here < there else -1) * occlusion[channel, y, x] / OCCLUSION_STEPS)
    assert meetings.pairs.tolist() == [[0, 1]]
    (row,) = meetings.features
    assert row[OrderFeature.OCCLUSION] == pytest.approx(np.mean(log_odds) * np.sqrt(len(log_odds)))
    assert row[OrderFeature.OCCLUSION_VOTES] == pytest.approx(np.tanh(np.array(log_odds) / 2).mean())


def test_a_stroke_that_is_seen_where_two_cross_lies_above(crossed):
    (row,) = find_meetings(*crossed).features
    assert row[OrderFeature.CROSSING] > 0.9  # the second stroke owns all 12 x 12 pixels
    assert row[OrderFeature.CROSSING_PIXELS] == pytest.approx(12 * row[OrderFeature.CROSSING], rel=0.05)


def test_what_speaks_for_one_of_two_speaks_against_the_other(crossed):
    regions, fitted = crossed
    turned = np.array([1, 0, 2])
    labels = np.where(regions.labels >= 0, turned[regions.labels], -1).astype(np.int32)
    other = replace(regions, labels=labels, chance=regions.chance[turned], attributes=regions.attributes[turned])
    one = find_meetings(regions, fitted)
    two = find_meetings(other, StrokeCurves(*(part[turned] for part in fitted)))
    np.testing.assert_array_equal(one.pairs, two.pairs)
    np.testing.assert_allclose(one.features, -two.features, atol=1e-9)


def test_regions_that_do_not_meet_have_any_order(crossed):
    regions, fitted = crossed
    alone = replace(regions, labels=np.where(regions.labels == 0, -1, regions.labels))
    meetings = find_meetings(alone, fitted)
    assert len(meetings.pairs) == len(meetings.features) == 0
    order = rank_strokes(3, meetings.pairs, meetings.features @ np.ones(len(OrderFeature)))
    assert sorted(order) == [0, 1, 2]


def test_strokes_are_ranked_as_the_evidence_says():
    random = np.random.default_rng(0)
    order = random.permutation(30)
    pairs = np.array([pair for pair in combinations(range(30), 2) if random.random() < 0.3])
    rank = order.argsort()
    evidence = np.sign(rank[pairs[:, 1]] - rank[pairs[:, 0]]) * random.random(len(pairs))
    found = rank_strokes(30, pairs, evidence).argsort()
    assert sorted(found) == list(range(30))
    assert ((found[pairs[:, 1]] > found[pairs[:, 0]]) == (evidence > 0)).all()


def test_a_circle_of_evidence_is_broken_where_it_is_weakest():
    pairs, evidence = np.array([[0, 1], [1, 2], [0, 2]]), np.array([2.0, 3.0, -1.0])  # 0 below 1 below 2 below 0
    assert rank_strokes(3, pairs, evidence).tolist() == [0, 1, 2]
