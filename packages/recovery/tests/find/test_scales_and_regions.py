"""Test that a suitable scale is chosen, and that tiles find the same strokes as the whole picture."""

from functools import partial

import numpy as np
import pytest
from brushexp_recovery.find import regions, scale
from brushexp_recovery.find.regions import SEARCHES, Search
from brushexp_recovery.find.scale import weighted_median
from brushexp_recovery.raster.resampling import resample
from brushexp_recovery.raster.tiles import split_into_tiles
from recovery_scenes import KnownPainting, bristles, f1_of, picture_of, shipped, silent


@pytest.fixture(scope="module")
def painting() -> KnownPainting:
    return bristles((176, 208), 5)


@pytest.mark.parametrize(
    ("worth", "zoom"), [((0.50, 0.52, 0.4), 2.25), ((0.50, 0.53, 0.4), 1.5), ((0.1, 0.2, 0.3), 1.0)]
)
def test_a_scale_that_explains_clearly_more_is_taken_instead_of_the_guessed_one(monkeypatch, worth, zoom):
    shares = dict(zip((2.25, 1.5, 1.0), worth, strict=True))
    monkeypatch.setattr(scale, "guess_zoom", lambda *_: 2.25)
    monkeypatch.setattr(scale, "explained_share", lambda model, classifiers, parts, zoom: shares[round(zoom, 6)])
    assert scale.find_zoom(None, None, np.zeros((300, 400, 3), np.float32)) == pytest.approx(zoom)


def test_a_part_is_explained_by_the_regions_that_were_painted(painting):
    explained = partial(scale.explained_share, shipped(), shipped().classifiers())
    noise = np.random.default_rng(0).random((64, 64, 3)).astype(np.float32)
    assert 0.4 < explained([picture_of(painting)], 1.0) <= 1
    assert explained([noise], 1.0) < 0.2


@pytest.mark.parametrize("size", [0.7, 1.6])
def test_a_picture_of_another_size_is_looked_at_about_as_large(painting, size):
    image = picture_of(painting)
    zoom, other = (scale.find_zoom(shipped(), shipped().classifiers(), one) for one in (image, resample(image, size)))
    assert other * size == pytest.approx(zoom, rel=0.4)


@pytest.mark.parametrize("size", [(8, 8), (60, 9)])
def test_a_plain_picture_has_a_scale_and_no_strokes(size):
    found = regions.find_regions(shipped(), np.full((*size, 3), 0.3, np.float32), None, 1, silent)
    smallest, largest = scale.SCALES
    assert smallest <= found.zoom <= largest
    assert found.labels.shape == size
    assert (found.labels < 0).all()


def test_half_of_the_weight_lies_on_either_side_of_a_median():
    values, weights = np.array([5.0, 1.0, 3.0, 2.0]), np.array([1.0, 1.0, 1.0, 4.0])
    assert weighted_median(values, weights) == 2
    assert weighted_median(values, np.ones(4)) == 2
    assert weighted_median(np.array([4.0]), np.array([0.1])) == 4


def test_tiles_find_what_the_whole_picture_shows(monkeypatch, painting):
    image = picture_of(painting)
    whole = regions.find_regions(shipped(), image, 0.8, 1, silent).labels
    monkeypatch.setattr(regions, "TILE_SIDE", 128)
    monkeypatch.setattr(regions, "split_into_tiles", partial(split_into_tiles, margin=32))
    assert len(list(split_into_tiles(*image.shape[:2], 0.8, 128, 32))) > 1
    assert f1_of(regions.find_regions(shipped(), image, 0.8, 1, silent).labels, whole) > 0.7


def test_a_second_search_that_is_surer_everywhere_finds_what_it_finds_alone(painting):
    image = picture_of(painting)
    alone = regions.find_regions(shipped(), image, 0.8, 1, silent, SEARCHES[:1])
    both = regions.find_regions(shipped(), image, 1.6, 1, silent, (SEARCHES[0], Search(0.5, 10.0)))
    np.testing.assert_array_equal(both.labels, alone.labels)
    np.testing.assert_allclose(both.chance, 10 * alone.chance)


def test_a_search_that_is_worth_nothing_adds_nothing(painting):
    image = picture_of(painting)
    searches = SEARCHES[0], Search(SEARCHES[1].zoom, 0.0)
    one, both = (regions.find_regions(shipped(), image, 1.0, 1, silent, some) for some in (SEARCHES[:1], searches))
    np.testing.assert_array_equal(both.labels, one.labels)
    np.testing.assert_array_equal(both.chance, one.chance)
