"""Test that loops over label images and pixel pairs agree with straightforward implementations."""

import numpy as np
import pytest
import torch
from brushexp_recovery.raster.labels import color_labels, count_pixels, group_pixels, mean_colors
from brushexp_recovery.raster.offsets import pair_slices, shift
from brushexp_recovery.raster.overlap import overlaps_between


@pytest.mark.parametrize("count", [0, 7])
def test_pixels_of_regions_are_listed(count):
    labels = np.random.default_rng(0).integers(-1, max(count - 1, 0), (20, 31)).astype(np.int32)  # the last is empty
    lists = group_pixels(labels, count)
    assert len(lists) == count
    for number, pixels in enumerate(lists):
        np.testing.assert_array_equal(pixels, np.flatnonzero(labels == number))


def test_colours_of_regions_are_means_and_a_region_without_pixels_is_black():
    random = np.random.default_rng(0)
    labels, image = random.integers(-1, 3, (9, 11)), random.random((9, 11, 3))
    colors = mean_colors(labels, image, 4)
    for number in range(3):
        np.testing.assert_allclose(colors[number], image[labels == number].mean(0))
    assert (colors[3] == 0).all()
    drawn = color_labels(labels)
    assert (drawn[labels < 0] == 0).all()
    assert len({tuple(color) for color in drawn[labels >= 0]}) == 3


def test_overlaps_are_those_of_a_slow_loop():
    random = np.random.default_rng(1)
    one, other = random.integers(-1, 3, (12, 9)), random.integers(-1, 4, (12, 9))
    found = {(a, b): iou for a, b, iou in zip(*overlaps_between(one, other, 3, 4), strict=True)}
    for a in range(3):
        for b in range(4):
            both, either = ((one == a) & (other == b)).sum(), ((one == a) | (other == b)).sum()
            assert found.get((a, b), 0) == pytest.approx(both / either)
    nothing = overlaps_between(np.full((3, 3), -1), other[:3, :3], 0, 4)
    assert [len(part) for part in nothing] == [0, 0, 0]
    assert count_pixels(one, 5).tolist() == [*(int((one == k).sum()) for k in range(3)), 0, 0]


@pytest.mark.parametrize("offset", [(0, 1), (3, -2), (4, 4), (0, 9), (9, 1), (2, -9)])
def test_partners_of_pixels_lie_at_their_offset(offset):
    size = (5, 7)
    here, there = pair_slices(size, offset)
    rows, columns = np.mgrid[: size[0], : size[1]]
    np.testing.assert_array_equal(rows[there] - rows[here], offset[0])
    np.testing.assert_array_equal(columns[there] - columns[here], offset[1])
    inside = (rows + offset[0] < size[0]) & (columns + offset[1] < size[1]) & (columns + offset[1] >= 0)
    assert rows[here].size == inside.sum()
    moved = shift(torch.arange(1.0, 36.0).reshape(size), *offset).numpy()
    np.testing.assert_array_equal(moved[here], np.arange(1.0, 36.0).reshape(size)[there])
    assert (moved != 0).sum() == inside.sum()
