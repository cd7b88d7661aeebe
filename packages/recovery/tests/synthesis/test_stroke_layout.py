"""Test that stroke layouts are reproducible, that strokes end at edges, and that positions on a grid are spaced out."""

import numpy as np
import pytest
from brushexp_recovery.curves.bezier import chords_of
from brushexp_recovery.synthesis.direction_field import add_hatching, edge_directions
from brushexp_recovery.synthesis.hand import TRACE_STEPS, Hand
from brushexp_recovery.synthesis.layout import lay_strokes
from brushexp_recovery.synthesis.placement import on_grid, scatter
from brushexp_recovery.synthesis.streamlines import SURE_STEPS, curves_along

LEVEL = Hand(directions=64, shaky=0.0)


def test_strokes_are_laid_the_same_way_twice_and_cover_the_picture():
    picture = np.random.default_rng(0).random((64, 96, 3)).astype(np.float32)
    hand = Hand(hatch=0.5, palette=4, sway=0.3, taper=0.2)
    one, two = (lay_strokes(picture, 40, hand, np.random.default_rng(1)) for _ in range(2))
    np.testing.assert_array_equal(one.curve, two.curve)
    assert one.curve.shape == (40, 3, 2)
    assert (one.width > 0).all()
    assert ((one.color >= 0.01) & (one.color <= 0.99)).all()


@pytest.mark.parametrize(("clip", "ends"), [(0.1, [4, 52]), (0.0, [4, 76])])
def test_a_stroke_ends_where_the_picture_changes(clip, ends):
    picture = np.zeros((64, 96, 3), np.float32)
    picture[:, 48:] = 1
    places, half = np.array([[40.0, 20.0], [56.0, 40.0]]), np.array([36.0, 36.0])
    hand = Hand(directions=LEVEL.directions, shaky=LEVEL.shaky, clip=clip)
    curve = curves_along(np.zeros(picture.shape[:2]), picture, places, half, hand, np.random.default_rng(0))
    step = half[0] / TRACE_STEPS
    assert ends[1] in (40 + SURE_STEPS * step, 76)  # steps that are always taken
    np.testing.assert_allclose(np.sort(curve[0, [0, 2], 0]), ends, atol=1.5 * step if clip else 1e-6)


@pytest.mark.parametrize("n", [0, 1, 7, 300])
def test_places_on_a_grid_keep_apart(n):
    places = on_grid(n, (64, 96), np.random.default_rng(0))
    assert places.shape == (n, 2)
    assert ((places >= 0) & (places < [96, 64])).all()
    if n > 1:
        apart = np.hypot(*(places[:, None] - places).transpose(2, 0, 1)) + 1e9 * np.eye(n)
        assert apart.min() > 0.4 * np.sqrt(64 * 96 / n)


@pytest.mark.parametrize("n", [7, 300])
def test_strokes_on_a_grid_have_a_length(n):
    picture = np.random.default_rng(1).random((64, 96, 3)).astype(np.float32)
    layout = lay_strokes(picture, n, Hand(even=True, clip=0.1), np.random.default_rng(2))
    assert len(layout) == n
    assert (np.hypot(*chords_of(layout.curve).T) > 0.5).all()


def test_scattered_places_are_denser_where_they_weigh_more():
    weight = np.ones((60, 90))
    weight[:, 45:] = 9
    places = scatter(80, weight, np.random.default_rng(0))
    left = (places[:, 0] < 45).sum()
    assert 0 < left < 25
    apart = np.hypot(*(places[:, None] - places).transpose(2, 0, 1)) + 1e9 * np.eye(80)
    assert apart.min() > 2
    assert scatter(0, weight, np.random.default_rng(0)).shape == (0, 2)


def test_directions_go_along_edges_and_hatching_replaces_them():
    rows, columns = np.mgrid[:48, :64]
    ramp = ((rows - columns) / 64)[..., None].repeat(3, 2)
    angles = edge_directions(ramp, 3.0)
    np.testing.assert_allclose(angles[20:28, 20:44], np.pi / 4, atol=0.02)
    hatched = add_hatching(angles, 1.0, np.random.default_rng(0))
    assert len(np.unique(hatched)) <= 30
    assert add_hatching(angles, 0.0, np.random.default_rng(0)) is angles
