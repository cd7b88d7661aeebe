"""Test that confidence features describe regions, and that calibration compares confidence with correctness."""

from dataclasses import replace

import numpy as np
import pytest
from brushexp_recovery.confidence.calibration import ReliabilityBin, auc_of, calibration_of, join_reliability
from brushexp_recovery.confidence.features import DOUBT, confidence_features
from brushexp_recovery.model.channels import StrokeAttribute
from brushexp_recovery.model.features import ConfidenceFeature
from recovery_regions import crossed_regions


def test_features_say_how_sure_all_looks_are_and_what_is_seen_of_a_region():
    regions = replace(crossed_regions(), chance=np.array([0.0, 0.5, 1.0]))
    features = confidence_features(regions)
    chance = 1 / (1 + np.exp(-features[:, ConfidenceFeature.LOG_ODDS]))
    np.testing.assert_allclose(chance, [DOUBT, 0.5, 1 - DOUBT])
    visible = regions.attributes[:, StrokeAttribute.VISIBLE]
    np.testing.assert_allclose(features[:, ConfidenceFeature.VISIBLE], visible)
    # 8 x 18 pixels equal the area expected from the sides
    np.testing.assert_allclose(features[2, ConfidenceFeature.LOG_FILL], 0, atol=1e-9)
    nothing = np.empty((0, len(StrokeAttribute)))
    empty = replace(regions, labels=np.full((9, 9), -1, np.int32), chance=np.empty(0), attributes=nothing)
    assert confidence_features(empty).shape == (0, len(ConfidenceFeature))


def test_a_confidence_is_compared_with_what_is_right():
    hit = np.array([True, False, True, True])
    figures = calibration_of(np.array([0.95, 0.15, 0.55, 0.55]), hit)
    assert figures["reliability"] == [(pytest.approx(0.15), 0, 1), (pytest.approx(0.55), 1, 2), (0.95, 1, 1)]
    assert figures["ece"] == pytest.approx((0.15 + 2 * 0.45 + 0.05) / 4)
    assert figures["auc"] == 1
    joined = join_reliability([figures["reliability"], [ReliabilityBin(0.51, 0.0, 2)]])
    assert joined[1] == (pytest.approx(0.53), pytest.approx(0.5), 4)


def test_ties_count_half_and_nothing_to_compare_is_undefined():
    assert auc_of(np.array([0.5, 0.7]), np.array([0.5])) == pytest.approx(0.75)
    assert np.isnan(auc_of(np.empty(0), np.array([0.5])))
    figures = calibration_of(np.empty(0), np.empty(0, bool))
    assert np.isnan(figures["ece"])
    assert figures["reliability"] == []
