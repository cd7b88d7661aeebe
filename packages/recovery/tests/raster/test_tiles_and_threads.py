"""Test that tiles cover a picture, that threads return results in order, and that recovery returns freed memory."""

import numpy as np
import pytest
import torch
from brushexp_recovery.model.recovery_model import RecoveryModel
from brushexp_recovery.raster import threads
from brushexp_recovery.raster.boxes import Box
from brushexp_recovery.raster.threads import map_on_threads
from brushexp_recovery.raster.tiles import split_into_tiles
from brushexp_recovery.recover import pipeline
from recovery_scenes import silent


@pytest.fixture
def three_threads():
    before = torch.get_num_threads()
    torch.set_num_threads(3)
    yield
    assert torch.get_num_threads() == 3
    torch.set_num_threads(before)


def test_results_come_in_the_order_of_the_items_each_computed_on_one_thread(three_threads):
    results = list(map_on_threads(lambda item: (item, torch.get_num_threads()), range(20)))
    assert results == [(item, 1) for item in range(20)]


def test_an_error_on_a_thread_is_an_error(three_threads):
    with pytest.raises(ZeroDivisionError):
        list(map_on_threads(lambda item: 1 // item, [2, 1, 0, 3]))


def test_memory_is_given_back_until_curves_are_fitted(monkeypatch):
    calls, refine = [], pipeline.refine_curves

    def spy(*args, **words):
        calls.append("refined")
        return refine(*args, **words)

    monkeypatch.setattr(threads, "keep_memory", lambda *most: calls.append(most))
    monkeypatch.setattr(pipeline, "refine_curves", spy)
    pipeline.recover_with(RecoveryModel().eval(), np.full((48, 48, 3), 0.5, np.float32), 1.0, 1, silent)
    assert calls == [(threads.KEPT_ARRAY,), "refined", ()]


@pytest.mark.parametrize("size", [(1, 1), (300, 200), (5000, 3), (1900, 2500)])
@pytest.mark.parametrize("zoom", [0.3, 1.0, 2.2])
def test_every_pixel_is_in_the_core_of_one_tile(size, zoom):
    cores = np.zeros(size, int)
    for box, core in split_into_tiles(*size, zoom, 576):
        assert core.intersection(box) == core
        assert max(box.size) <= 576 / zoom + 1
        cores[core.slices] += 1
    assert (cores == 1).all()


def test_boxes_meet_and_are_counted_from_each_other():
    one, other = Box(2, 9, 1, 5), Box(4, 12, 3, 8)
    both = one.intersection(other)
    assert both == Box(4, 9, 3, 5)
    assert both.within(one) == Box(2, 7, 2, 4)
    picture = np.arange(12 * 9).reshape(12, 9)
    np.testing.assert_array_equal(picture[one.slices][both.within(one).slices], picture[both.slices])
    assert one.intersection(Box(9, 12, 0, 9)).is_empty
    assert not both.is_empty
