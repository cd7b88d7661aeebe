"""Test that strokes fill shapes, and follow paths only as far as they can bend."""

import numpy as np
import pytest
from brushexp_media.init.shapes import fill_shape, remove_specks
from brushexp_media.picture.lines import follow_flow, points_of

from brushexp.pictures.structure import sample_at


def disc(radius, size=(90, 120)):
    y, x = np.mgrid[: size[0], : size[1]]
    return (x - 60) ** 2 + (y - 45) ** 2 < radius**2


def test_small_parts_are_dropped_and_small_holes_filled():
    mask = disc(30) & ~disc(3)
    mask[:2, :2] = True
    np.testing.assert_array_equal(remove_specks(mask, 50), disc(30))
    np.testing.assert_array_equal(remove_specks(mask, 0), mask)


@pytest.mark.parametrize("broadest", [12.0, 60.0])
def test_a_shape_is_filled_by_broad_strokes_that_stay_in_it(broadest):
    mask = disc(30)
    curve, half = fill_shape(mask, 200, broadest, np.random.default_rng(0))
    assert half.max() <= broadest / 2
    points = points_of(curve)
    assert sample_at(mask, *points.reshape(-1, 2).T).mean() > 0.98
    y, x = np.nonzero(mask)
    near = np.full(len(x), np.inf)
    for middle, reach in zip(points.swapaxes(0, 1), half, strict=True):
        away = np.hypot(x[:, None] + 0.5 - middle[:, 0], y[:, None] + 0.5 - middle[:, 1]).min(1) - reach
        near = np.minimum(near, away)
    assert (near < 1).mean() > 0.97
    assert len(fill_shape(mask, 3, broadest, np.random.default_rng(0))[0]) == 3
    assert len(fill_shape(~mask & mask, 3, broadest, np.random.default_rng(0))[0]) == 0


def test_a_line_ends_where_its_way_bends_more_than_a_curve_can():
    y, x = np.mgrid[:120, :120] - 60.0
    round_about = np.arctan2(y, x) + np.pi / 2
    curve = follow_flow(np.array([[60.0, 80.0]]), round_about, np.array([60.0]), np.ones((120, 120)), 0.5)
    radius = np.hypot(*(points_of(curve)[:, 0] - 60).T)
    assert np.abs(radius - 20).max() < 5
    level = follow_flow(np.array([[60.0, 80.0]]), np.zeros((1, 1)), np.array([40.0]), np.ones((120, 120)), 0.5)
    np.testing.assert_allclose(level[0], [[20, 80], [60, 80], [100, 80]])
