"""Marks by a formula, hands that end strokes at edges, and pictures without strokes."""

import numpy as np
import pytest
from brushexp_recovery.synthesis import Hand, Laid, curves_along, lay_strokes, on_grid
from brushexp_recovery.synthesis_canvas import Mixing, compose, geometry_of
from brushexp_recovery.synthesis_crops import crop
from brushexp_recovery.synthesis_marks import Marks, any_marks, draw_marks
from brushexp_recovery.synthesis_paintings import without_strokes

SIZE = (80, 120)
SMOOTH = Marks(ends=0.05, streak=0.0)


def laid_of(*curves, width=16.0):
    n = len(curves)
    none = np.zeros(n)
    return Laid(np.array(curves, float), np.full(n, width), np.full((n, 3), 0.4), none, none)


def painted_with(marks, laid, seed=0):
    drawn = draw_marks(laid, marks, SIZE, np.random.default_rng(seed))
    mixing = Mixing(1.0, np.ones(len(laid.width)), np.zeros(len(laid.width)))
    return drawn, compose(drawn, laid, mixing, np.ones((*SIZE, 3)))


def test_a_smooth_mark_covers_what_lies_near_its_curve():
    curve = [(24, 40), (60, 22), (96, 46)]
    _, composed = painted_with(SMOOTH, laid_of(curve))
    t = np.linspace(0, 1, 400)[:, None]
    points = (1 - t) ** 2 * curve[0] + 2 * t * (1 - t) * np.array(curve[1]) + t**2 * curve[2]
    rows, columns = np.mgrid[: SIZE[0], : SIZE[1]] + 0.5
    away = np.hypot(columns[..., None] - points[:, 0], rows[..., None] - points[:, 1])
    near, middle = away.min(-1), (away.argmin(-1) > 20) & (away.argmin(-1) < 380)
    seen = composed.labels == 0
    sure = middle & (abs(near - 8) > 2)  # each stroke departs from its painting's marks a little
    np.testing.assert_array_equal(seen[sure], near[sure] < 8)
    assert not seen[(near > 12)].any()
    np.testing.assert_allclose(composed.image[middle & (near < 5)], 0.4, atol=0.01)


def test_paint_that_runs_out_breaks_up_and_its_region_has_no_gaps():
    marks = Marks(ends=0.05, full=2.0, dry=2.2, bristle=0.6, grain=0.6, sharp=3.0)
    curves = [[(16, y), (60, y), (104, y)] for y in (20, 60)]
    _, composed = painted_with(marks, laid_of(*curves))
    paint = composed.image[..., 0] < 0.7
    bands = [np.s_[13:27], np.s_[53:67]]
    begin, end = (np.mean([paint[rows, columns].mean() for rows in bands]) for columns in (np.s_[24:40], np.s_[84:100]))
    assert begin > 0.95
    assert 0.1 < end < 0.8
    region = composed.labels >= 0
    late = np.mean([region[rows, 84:100].mean() for rows in bands])
    assert late > end + 0.1
    assert region[paint].mean() > 0.95


def test_any_marks_are_drawn_the_same_way_twice_and_have_a_geometry():
    laid = laid_of([(10, 10), (40, 30), (80, 12)], [(20, 60), (20, 60), (21, 60)], width=6.0)
    for seed in range(12):
        marks = any_marks(np.random.default_rng(seed))
        assert marks == any_marks(np.random.default_rng(seed))
        (drawn, composed), (again, _) = (painted_with(marks, laid, seed) for _ in range(2))
        np.testing.assert_array_equal(drawn.texels, again.texels)
        assert ((drawn.texels >= 0) & (drawn.texels <= 1)).all()
        assert (drawn.texels[:, 4] >= drawn.texels[:, 3] - 1e-6).all()
        assert np.isfinite(geometry_of(drawn, composed)).all()


def test_a_stroke_ends_where_the_picture_changes():
    picture = np.zeros((64, 96, 3), np.float32)
    picture[:, 48:] = 1
    places, half = np.array([[40.0, 20.0], [56.0, 40.0]]), np.array([36.0, 36.0])
    angles, hand = np.zeros(picture.shape[:2]), Hand(directions=64, shaky=0.0, clip=0.1)
    ends = curves_along(angles, picture, places, half, hand, np.random.default_rng(0))[:, [0, 2], 0]
    step = half[0] / 12
    first = 40 + 4 * step  # so far it goes in any case
    np.testing.assert_allclose(np.sort(ends[0]), [4, max(first, 48)], atol=1.5 * step)
    free = curves_along(angles, picture, places, half, Hand(directions=64, shaky=0.0), np.random.default_rng(0))
    np.testing.assert_allclose(np.sort(free[0, [0, 2], 0]), [4, 76], atol=1e-6)


@pytest.mark.parametrize("n", [0, 1, 7, 300])
def test_places_on_a_grid_keep_apart(n):
    places = on_grid(n, (64, 96), np.random.default_rng(0))
    assert places.shape == (n, 2)
    assert ((places >= 0) & (places < [96, 64])).all()
    if n > 1:
        apart = np.hypot(*(places[:, None] - places).transpose(2, 0, 1)) + 1e9 * np.eye(n)
        assert apart.min() > 0.4 * np.sqrt(64 * 96 / n)
        picture = np.random.default_rng(1).random((64, 96, 3)).astype(np.float32)
        laid = lay_strokes(picture, n, Hand(even=True, clip=0.1), np.random.default_rng(2))
        assert laid.curve.shape == (n, 3, 2)
        assert (np.hypot(*(laid.curve[:, 2] - laid.curve[:, 0]).T) > 0.5).all()


@pytest.mark.parametrize("seed", range(4))
def test_what_has_no_strokes_is_all_ground_in_every_crop(seed):
    random = np.random.default_rng(seed)
    painted = without_strokes(random.random((96, 96, 3)).astype(np.float32), random)
    image, labels, maps = crop(painted, random, 64)
    assert image.shape == (3, 64, 64)
    assert (labels == -1).all()
    assert not maps[2:].any()
