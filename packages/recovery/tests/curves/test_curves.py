"""Test that curves are fitted to regions, jointly refined to match the visible parts, and trimmed to their paint."""

import numpy as np
import pytest
from brushexp_recovery.curves import refine
from brushexp_recovery.curves.bezier import arc_lengths, part_of
from brushexp_recovery.curves.coverage import NO_COVER, cover_strokes, overlapping_pairs, visible_labels
from brushexp_recovery.curves.fit import StrokeCurves, fit_curve
from brushexp_recovery.curves.refine import refine_curves
from brushexp_recovery.curves.round_line import trim_to_paint
from brushexp_recovery.model.channels import CENTRE, DIRECTION, LOG_SIZE, StrokeAttribute
from recovery_scenes import bars, silent, straight

ROUGH = np.array([[[25.0, 40.0], [60, 50], [95, 60]], [[70, 20], [60, 45], [50, 75]]])  # close to the curves of `bars`


def test_a_straight_region_becomes_its_stroke():
    rows, columns = np.mgrid[:60, :80] + 0.5
    along, across = (columns - 40) * 0.8 + (rows - 30) * 0.6, (rows - 30) * 0.8 - (columns - 40) * 0.6
    inside = (np.abs(along) < 25) & (np.abs(across) < 5)
    points = np.stack([columns[inside], rows[inside]], 1)
    angle = 2 * np.arctan2(0.6, 0.8)
    attributes = np.ones(len(StrokeAttribute))
    attributes[CENTRE] = 40, 30
    attributes[DIRECTION] = np.cos(angle), np.sin(angle)
    attributes[LOG_SIZE] = np.log((10, 50))
    curve, width = fit_curve(points, attributes)
    assert width == pytest.approx(10, rel=0.1)
    chord = curve[2] - curve[0]
    assert abs(np.arctan2(chord[1], chord[0])) == pytest.approx(angle / 2, abs=0.02)
    np.testing.assert_allclose(curve.mean(0), [40, 30], atol=0.5)
    assert np.linalg.norm(chord) + width == pytest.approx(50, rel=0.1)


def test_refining_moves_strokes_onto_their_regions():
    labels = bars().labels.astype(np.int32)
    rough = StrokeCurves(ROUGH, np.array([12.0, 28.0]), np.zeros((2, 3)))
    before = mean_iou(rough, labels)
    after = mean_iou(refine_curves(rough, labels, np.arange(2), show=silent), labels)
    assert after > before + 0.1
    assert after > 0.9


def mean_iou(fitted: StrokeCurves, labels: np.ndarray) -> float:
    """Compute the mean IoU between the visible parts of two strokes and their regions."""
    drawn, _ = visible_labels(cover_strokes(fitted.curve, fitted.width, labels.shape), np.ones(2), labels.shape)
    return float(np.mean([((drawn == k) & (labels == k)).sum() / ((drawn == k) | (labels == k)).sum() for k in (0, 1)]))


def test_a_large_picture_is_refined_as_a_small_one(monkeypatch):
    labels = np.tile(bars().labels.astype(np.int32), (1, 3))
    labels[labels >= 0] += 2 * (np.arange(384) // 128)[None].repeat(96, 0)[labels >= 0]
    curve = np.concatenate([ROUGH + np.array([128.0 * k, 0]) for k in range(3)])
    rough = StrokeCurves(curve, np.tile([12.0, 28.0], 3), np.zeros((6, 3)))
    whole = refine_curves(rough, labels, np.arange(6), show=silent)
    monkeypatch.setattr(refine, "TILE_SIDE", 200)
    tiled = refine_curves(rough, labels, np.arange(6), show=silent)
    np.testing.assert_allclose(tiled.width, whole.width, rtol=0.1)
    np.testing.assert_allclose(tiled.curve, whole.curve, atol=5)


def test_curves_are_cut_to_their_paint():
    curve = straight(((0, 0), (10, 0)))
    expected = straight(((2, 0), (7, 0)))
    np.testing.assert_allclose(part_of(curve, np.array([0.2]), np.array([0.7])), expected)
    area = np.array([50 * 8 - 0.215 * 64])
    cut, width = trim_to_paint(straight(((0, 0), (100, 0))), np.array([0.1]), np.array([0.6]), area)
    assert width == pytest.approx(8, rel=0.01)
    assert arc_lengths(cut) == pytest.approx(50 - 0.9 * width)


def test_strokes_cover_what_is_near_them_and_nothing_off_the_canvas():
    curve = straight(((10, 10), (50, 10)), ((30, 2), (30, 18)), ((200, 5), (220, 5)))
    covers = cover_strokes(curve, np.full(3, 6.0), (20, 60))
    assert covers[2] == NO_COVER
    labels, area = visible_labels(covers, np.ones(3), (20, 60))
    assert area.tolist() == [pytest.approx(40 * 6 + 9 * np.pi, rel=0.05), pytest.approx(16 * 6 + 20, rel=0.05), 0]
    assert labels[10, 12] == 0
    assert labels[10, 30] == 1
    assert labels[1, 1] == -1
    assert overlapping_pairs(covers, 12, 0.05).tolist() == [[0, 1]]
    assert overlapping_pairs(covers, 12, 0.5).tolist() == []
    assert overlapping_pairs([], 12, 0.5).shape == (0, 2)
