"""Test that smooth procedural marks cover their curves, that dry marks break up, and that all are reproducible."""

import numpy as np
import pytest
from brushexp_recovery.curves.bezier import points_on
from brushexp_recovery.synthesis.canvas import Canvas, compose, geometry_of, opaque_mixing
from brushexp_recovery.synthesis.layout import StrokeLayout
from brushexp_recovery.synthesis.marks import Marks, choose_marks, draw_marks
from brushexp_recovery.synthesis.windows import StrokeWindows, Texel
from recovery_scenes import plain_strokes, straight

SIZE = (80, 120)
SMOOTH = Marks(ends=0.05, streak=0.0)


def paint_with(marks: Marks, layout: StrokeLayout, seed: int = 0) -> tuple[StrokeWindows, Canvas]:
    windows = draw_marks(layout, marks, SIZE, np.random.default_rng(seed))
    return windows, compose(windows, layout, opaque_mixing(len(layout), 1.0), np.ones((*SIZE, 3)))


def test_a_smooth_mark_covers_what_lies_near_its_curve():
    curve = np.array([[(24, 40), (60, 22), (96, 46)]])
    _, canvas = paint_with(SMOOTH, plain_strokes(curve, 16.0))
    (points,) = points_on(curve, 400)
    rows, columns = np.mgrid[: SIZE[0], : SIZE[1]] + 0.5
    distance = np.hypot(columns[..., None] - points[:, 0], rows[..., None] - points[:, 1])
    near, middle = distance.min(-1), (distance.argmin(-1) > 20) & (distance.argmin(-1) < 380)
    visible = canvas.labels == 0
    sure = middle & (abs(near - 8) > 2)  # each stroke varies slightly from its painting's marks
    np.testing.assert_array_equal(visible[sure], near[sure] < 8)
    assert not visible[near > 12].any()
    np.testing.assert_allclose(canvas.image[middle & (near < 5)], 0.4, atol=0.01)


def test_paint_that_runs_out_breaks_up_and_its_region_has_no_gaps():
    marks = Marks(ends=0.05, full=2.0, dry=2.2, bristle=0.6, grain=0.6, sharp=3.0)
    _, canvas = paint_with(marks, plain_strokes(straight(((16, 20), (104, 20)), ((16, 60), (104, 60))), 16.0))
    paint, region = canvas.image[..., 0] < 0.7, canvas.labels >= 0
    bands = [np.s_[13:27], np.s_[53:67]]
    begin, end = (np.mean([paint[rows, columns].mean() for rows in bands]) for columns in (np.s_[24:40], np.s_[84:100]))
    assert begin > 0.95
    assert 0.1 < end < 0.8
    assert np.mean([region[rows, 84:100].mean() for rows in bands]) > end + 0.1
    assert region[paint].mean() > 0.95


@pytest.mark.parametrize("seed", range(12))
def test_any_marks_are_drawn_the_same_way_twice_and_have_a_geometry(seed):
    layout = plain_strokes([[(10, 10), (40, 30), (80, 12)], [(20, 60), (20, 60), (21, 60)]], 6.0)
    marks = choose_marks(np.random.default_rng(seed))
    assert marks == choose_marks(np.random.default_rng(seed))
    (windows, canvas), (again, _) = (paint_with(marks, layout, seed) for _ in range(2))
    np.testing.assert_array_equal(windows.texels, again.texels)
    assert ((windows.texels >= 0) & (windows.texels <= 1)).all()
    assert (windows.texels[:, Texel.CLOSED] >= windows.texels[:, Texel.ALPHA] - 1e-6).all()
    assert np.isfinite(geometry_of(windows, canvas)).all()
