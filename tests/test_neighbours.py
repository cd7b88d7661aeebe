"""Nearest strokes against all distances, and where there are hardly any."""

import pytest
import torch

from brushexp.strokes.neighbours import nearest


def test_nearest_agrees_with_all_distances():
    points = torch.rand(30, 2, dtype=torch.float64)
    gaps = torch.cdist(points, points)
    assert torch.equal(nearest(points, points, 4, exclude_self=False), gaps.argsort(1)[:, :4])
    assert torch.equal(nearest(points, points, 4, exclude_self=True), gaps.argsort(1)[:, 1:5])


def test_no_stroke_is_its_own_neighbour_even_where_all_share_a_place():
    points = torch.zeros(20, 2)
    found = nearest(points, points, 5, exclude_self=True)
    assert found.shape == (20, 5)
    assert not (found == torch.arange(20)[:, None]).any()


@pytest.mark.parametrize(("n", "k"), [(0, 3), (1, 3), (2, 3), (4, 3), (4, 10)])
def test_of_few_strokes_all_others_are_near(n, k):
    points = torch.rand(n, 2)
    found = nearest(points, points, k, exclude_self=True)
    assert found.shape == (n, min(k, max(n - 1, 0)))
    assert nearest(torch.rand(5, 2), points, k, exclude_self=False).shape == (5, min(k, n))
    for i, row in enumerate(found.tolist()):
        assert i not in row
        assert len(set(row)) == len(row)
