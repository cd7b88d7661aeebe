"""Test that paintings are determined by their seed and number, and that their ground truth describes their strokes."""

import os

import numpy as np
import pytest
from brushexp_recovery.synthesis import paintings, pool
from brushexp_recovery.synthesis.canvas import StrokeGeometry
from brushexp_recovery.synthesis.paintings import PICTURES, make_bare, paint
from brushexp_recovery.train.crops import cut_crop
from recovery_scenes import bars


def test_the_truth_of_a_painting_is_that_of_its_strokes():
    painting = bars()
    geometry = painting.geometry
    middle = geometry[:, [StrokeGeometry.CENTRE_X, StrokeGeometry.CENTRE_Y]]
    np.testing.assert_allclose(middle, [[60, 48], [60, 48]], atol=0.5)
    np.testing.assert_allclose(np.exp(geometry[:, StrokeGeometry.LOG_WIDTH]), 20, rtol=0.05)
    np.testing.assert_allclose(np.exp(geometry[:, StrokeGeometry.LOG_LENGTH]), 90, rtol=0.06)
    lower, upper = geometry[:, StrokeGeometry.VISIBLE]
    assert upper == 1
    assert lower == pytest.approx(1 - 20 * 20 / (70 * 20 + np.pi * 100), abs=0.02)
    assert np.cos(2 * (geometry[0, StrokeGeometry.ANGLE] - 0.4)) == pytest.approx(1, abs=1e-3)
    assert painting.labels[48, 60] == 1


@pytest.mark.parametrize("number", [1, 2, 4, paintings.FIRST_PLAIN])
def test_a_painting_is_decided_by_its_seed_and_number(number, monkeypatch):
    monkeypatch.setattr(paintings, "PAINTING_SIDE", 96)
    monkeypatch.setattr(paintings, "STROKES", (8, 20))
    monkeypatch.setattr(paintings, "FAMILY_STROKES", (8, 20))
    monkeypatch.setattr(paintings, "MOST_FLUID", 8)
    one, two = (paint(3, number, PICTURES) for _ in range(2))
    for name, value in vars(one).items():
        np.testing.assert_array_equal(value, getattr(two, name))
    assert one.image.shape == (96, 96, 3)
    n = len(one.geometry)
    assert one.labels.max() < n
    visible = np.bincount(one.labels[one.labels >= 0], minlength=n)
    share = visible / np.maximum(visible.max(initial=1), 1)
    assert np.isfinite(one.geometry).all()
    assert (one.geometry[share == 0, StrokeGeometry.VISIBLE] == 0).all()


@pytest.mark.parametrize("seed", range(4))
def test_what_has_no_strokes_is_all_ground_in_every_crop(seed):
    random = np.random.default_rng(seed)
    painting = make_bare(random.random((96, 96, 3)).astype(np.float32), random)
    crop = cut_crop(painting, random, 64)
    assert crop.image.shape == (3, 64, 64)
    assert (crop.labels == -1).all()
    assert not crop.attributes[2:].any()


def test_a_pool_is_filled_as_long_as_the_training_lives(tmp_path, monkeypatch):
    monkeypatch.setattr(pool, "paint", lambda *_: bars())
    pool.fill_pool(os.getppid(), tmp_path / "now", 0, range(2), [])
    assert len([*(tmp_path / "now").glob("*.npz")]) == 2
    again = pool.load_painting(tmp_path / "now" / "000001.npz")
    np.testing.assert_array_equal(again.geometry, bars().geometry)
    pool.fill_pool(os.getpid(), tmp_path / "later", 0, range(2), [])  # not the parent of this process
    assert not [*(tmp_path / "later").glob("*.npz")]
