"""Test that each paint family makes reproducible pictures with ground truth, and that sheets bend along curves."""

import numpy as np
import pytest
from brushexp_recovery.synthesis import paintings
from brushexp_recovery.synthesis.canvas import Mixing, compose, geometry_of, opaque_mixing
from brushexp_recovery.synthesis.families.family import find_families, paint_family
from brushexp_recovery.synthesis.hand import Hand
from brushexp_recovery.synthesis.layout import lay_strokes
from brushexp_recovery.synthesis.paintings import PICTURES, family_of
from brushexp_recovery.synthesis.sheets import Sheet, draw_sheets, grey_tint
from recovery_scenes import plain_strokes, straight

from brushexp.contracts.strokes import SCAN_COLUMNS, SCAN_ROWS, read_scans

SIDE = 96


def smooth_picture() -> np.ndarray:
    rows, columns = np.mgrid[:SIDE, :SIDE] / SIDE
    return np.stack([0.5 + 0.4 * np.sin(3 * rows + 2 * columns + k) for k in range(3)], 2).astype(np.float32)


def paint(name: str, count: int, seed: int):
    ground = np.full((SIDE, SIDE, 3), 0.6, np.float32)
    return paint_family(name, smooth_picture(), count, ground, np.random.default_rng(seed))


@pytest.mark.parametrize("name", sorted(find_families()))
def test_a_family_paints_the_same_picture_twice_and_knows_its_strokes(name):
    one, two = (paint(name, 12, 3) for _ in range(2))
    np.testing.assert_array_equal(one.image, two.image)
    assert np.isfinite(one.image).all()
    assert one.image.min() >= 0
    assert one.image.max() <= 1
    labels = one.canvas.labels
    assert labels.min() >= -1
    assert len(np.unique(labels[labels >= 0])) >= 3
    assert np.isfinite(geometry_of(one.windows, one.canvas)).all()
    assert not np.array_equal(one.image, paint(name, 12, 4).image)


@pytest.mark.parametrize("name", sorted(find_families()))
def test_a_family_draws_a_stroke_wider_than_the_picture_and_one_of_a_pixel(name):
    family = find_families()[name](np.random.default_rng(0))
    layout = plain_strokes(straight(((10, 20), (400, 300)), ((30, 30), (30.2, 30))), 1.0)
    layout.width[0] = 200.0
    windows = draw_sheets(layout, family.draw)
    canvas = compose(windows, layout, opaque_mixing(2, 1.0), np.ones((SIDE, SIDE, 3)))
    assert np.isfinite(windows.texels).all()
    assert (canvas.labels == 0).any()


def test_a_plain_sheet_covers_what_lies_near_its_curve():
    full = np.ones((40, 20), np.float32)
    layout = plain_strokes(straight(((20, 30), (76, 30))), 16.0)
    windows = draw_sheets(layout, lambda _: Sheet(full, grey_tint(full), full))
    canvas = compose(windows, layout, opaque_mixing(1, 1.0), np.ones((60, SIDE, 3)))
    seen = canvas.labels == 0
    assert seen[24:36, 22:74].all()
    assert not seen[:16].any()
    assert not seen[44:].any()
    np.testing.assert_allclose(canvas.image[30, 30:60], 0.4, atol=1e-3)


def test_scans_are_full_at_the_start_and_dry_at_the_end():
    scans = read_scans().astype(float) / 255
    assert scans.shape[1:] == (SCAN_ROWS, SCAN_COLUMNS)
    assert len(scans) > 40
    middle = scans[:, :, 20:44].mean((0, 2))
    begin, end = middle[40:60].mean(), middle[100:120].mean()
    assert begin > 0.8
    assert begin > end + 0.05


def test_bristles_carry_the_colours_that_they_pass():
    full = np.ones((40, 20), np.float32)
    layout = plain_strokes(straight(((10, 30), (86, 30))), 16.0)
    windows = draw_sheets(layout, lambda _: Sheet(full, grey_tint(full), full))
    ground = np.ones((60, SIDE, 3))
    ground[:, :48] = (1, 0, 0)
    ground[:30, :48] = (0, 0, 1)
    drag = Mixing(1.0, opacity=np.ones(1), wet=np.zeros(1), drag=np.full(1, 0.9))
    image = compose(windows, layout, drag, ground).image
    upper, lower = image[25, 52], image[35, 52]  # just beyond the border, on each side of the brush
    assert upper[2] > upper[0] + 0.1
    assert lower[0] > lower[2] + 0.1
    assert abs(image[30, 84] - 0.4).max() > 0.05  # white is also taken up


def test_strokes_of_a_row_lie_side_by_side_in_one_colour():
    hand = Hand(row=6, color=0.0, shaky=0.0)
    layout = lay_strokes(smooth_picture(), 60, hand, np.random.default_rng(1))
    alone = lay_strokes(smooth_picture(), 60, Hand(color=0.0, shaky=0.0), np.random.default_rng(1))

    def steps_of(one):
        middle = one.curve.mean(1)
        return np.linalg.norm(np.diff(middle, axis=0), axis=1) / one.width[1:]

    def jumps_of(one):
        return np.abs(np.diff(one.color, axis=0)).max(1)

    assert np.median(steps_of(layout)) < 2 < np.median(steps_of(alone))
    assert np.median(jumps_of(layout)) < 0.5 * np.median(jumps_of(alone))


def test_half_of_the_paintings_are_of_families_and_those_left_out_can_be_told(monkeypatch):
    chosen = [family_of(3, number) for number in range(400)]
    assert {name for name in chosen if name} == set(find_families())
    assert 0.4 < np.mean([name is not None for name in chosen]) < 0.6
    assert chosen == [family_of(3, number) for number in range(400)]
    assert family_of(3, paintings.FIRST_PLAIN) is None
    monkeypatch.setattr(paintings, "PAINTING_SIDE", SIDE)
    monkeypatch.setattr(paintings, "FAMILY_STROKES", (8, 12))
    painting = paintings.paint(3, 0, PICTURES, "dabs")
    assert painting.image.shape == (SIDE, SIDE, 3)
    assert (painting.labels >= 0).any()
