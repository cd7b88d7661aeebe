"""Test that superpixels, moments and affinities agree with straightforward loops over pixels."""

import numpy as np
import pytest
from brushexp_recovery.model.channels import AFFINITY_OFFSETS, CENTRE_UNIT, OCCLUSION_OFFSETS, StrokeAttribute
from brushexp_recovery.model.recovery_model import RecoveryModel
from brushexp_recovery.segment import region_adjacency
from brushexp_recovery.segment.affinity_maps import StrokeMaps, predict_maps
from brushexp_recovery.segment.moments import Moment, sum_moments
from brushexp_recovery.segment.region_adjacency import (
    DISTANCE_GROUPS,
    GROUP_OF_OFFSET,
    PAIRS,
    SUMS,
    AffinityColumn,
    adjacency_of,
)
from brushexp_recovery.segment.superpixels import superpixels_of
from brushexp_recovery.segment.watershed import border_strength, flood_basins
from recovery_scenes import bars, picture_of
from skimage.color import rgb2lab


def test_affinities_are_summed_as_by_a_plain_loop():
    random = np.random.default_rng(0)
    labels = random.integers(0, 9, (30, 41)).astype(np.int32)
    affinity = random.random((len(AFFINITY_OFFSETS), 30, 41)).astype(np.float32)
    within, between = np.zeros((9, len(AffinityColumn))), {}
    for channel, (dy, dx) in enumerate(AFFINITY_OFFSETS):
        for y in range(30 - dy):
            for x in range(max(0, -dx), 41 - max(0, dx)):
                a, b = sorted((int(labels[y, x]), int(labels[y + dy, x + dx])))
                row = within[a] if a == b else between.setdefault((a, b), np.zeros(len(AffinityColumn)))
                row[GROUP_OF_OFFSET[channel]] += affinity[channel, y, x]
                row[DISTANCE_GROUPS + GROUP_OF_OFFSET[channel]] += 1
    pairs = sorted(between)
    found = adjacency_of(labels, affinity)
    np.testing.assert_allclose(found.within, within)
    np.testing.assert_array_equal(found.pairs, pairs)
    np.testing.assert_allclose(found.between, [between[pair] for pair in pairs])


def test_a_table_of_pairs_grows_when_it_is_full(monkeypatch):
    monkeypatch.setattr(region_adjacency, "FIRST_ROOM", 1)
    labels = np.random.default_rng(0).permutation(3600).reshape(60, 60).astype(np.int32)
    _, pairs, between = adjacency_of(labels, np.ones((len(AFFINITY_OFFSETS), 60, 60), np.float32))
    assert len(pairs) == sum((60 - dy) * (60 - abs(dx)) for dy, dx in AFFINITY_OFFSETS)
    assert (between[:, SUMS].sum(0) == between[:, PAIRS].sum(0)).all()


def test_moments_are_sums_over_the_pixels_of_a_region():
    random = np.random.default_rng(0)
    size = (11, 17)
    labels, image = random.integers(0, 3, size), random.random((*size, 3))
    attributes = random.normal(size=(len(StrokeAttribute), *size)).astype(np.float32)
    paint = random.normal(size=size).astype(np.float32)
    maps = StrokeMaps(
        np.zeros((len(AFFINITY_OFFSETS), *size)), paint, attributes, np.zeros((len(OCCLUSION_OFFSETS), *size))
    )
    table = sum_moments(labels, image, maps)
    rows, columns = np.nonzero(labels == 1)
    lab, told = rgb2lab(image)[rows, columns].T, attributes[:, rows, columns]
    x, y = columns + 0.5, rows + 0.5
    centre_x, centre_y = (
        place + CENTRE_UNIT * told[k] for place, k in ((x, StrokeAttribute.CENTRE_X), (y, StrokeAttribute.CENTRE_Y))
    )
    expected = {
        Moment.AREA: len(x),
        Moment.XY: (x * y).sum(),
        Moment.YY: (y**2).sum(),
        Moment.B: lab[2].sum(),
        Moment.A_SQUARED: (lab[1] ** 2).sum(),
        Moment.CENTRE_X: centre_x.sum(),
        Moment.CENTRE_SQUARED: (centre_x**2 + centre_y**2).sum(),
        Moment.SINE: told[StrokeAttribute.SINE].sum(),
        Moment.LOG_WIDTH: told[StrokeAttribute.LOG_WIDTH].sum(),
        Moment.VISIBLE: (1 / (1 + np.exp(-told[StrokeAttribute.VISIBLE]))).sum(),
        Moment.PAINT: (1 / (1 + np.exp(-paint[rows, columns]))).sum(),
        Moment.LOG_LENGTH_SQUARED: (told[StrokeAttribute.LOG_LENGTH] ** 2).sum(),
    }
    for moment, value in expected.items():
        assert table[1, moment] == pytest.approx(value, rel=1e-5), moment.name


def test_superpixels_sum_up_to_the_picture():
    image = picture_of(bars())
    superpixels = superpixels_of(predict_maps(RecoveryModel().eval().network, image, 1), image)
    assert superpixels.moments[:, Moment.AREA].sum() == 96 * 128
    pairs = superpixels.within[:, PAIRS].sum() + superpixels.between[:, PAIRS].sum()
    assert pairs == pytest.approx(sum((96 - dy) * (128 - abs(dx)) for dy, dx in AFFINITY_OFFSETS))


def test_borders_lie_where_affinities_are_low_and_basins_between_them():
    labels = np.zeros((40, 60), int)
    labels[:, 30:] = 1
    affinity = np.stack([(labels == np.roll(labels, (-dy, -dx), (0, 1))) for dy, dx in AFFINITY_OFFSETS])
    borders = border_strength(affinity.astype(np.float32))
    inner = borders[5:-5, 5:-5]
    assert set(inner.argmax(1) + 5) <= {29, 30}
    assert inner[:, :18].max() == 0
    basins = flood_basins(borders)
    assert not set(basins[:, :30].ravel()) & set(basins[:, 30:].ravel())
