"""Tiles are dealt out to threads, memory is freed in time, and loops over pixels agree with slow ones."""

import sys
import weakref
from pathlib import Path

import numpy as np
import pytest
import torch
from brushexp_recovery import recover, regions
from brushexp_recovery.maps import predict
from brushexp_recovery.model import RecoveryModel
from brushexp_recovery.network import CHANNELS, OFFSETS, StrokeNetwork
from brushexp_recovery.raster import threads
from brushexp_recovery.raster.labels import group_pixels
from brushexp_recovery.raster.threads import map_on_threads, return_freed_memory
from brushexp_recovery.regions import GROUP, affinities_of


@pytest.fixture
def three_threads():
    before = torch.get_num_threads()
    torch.set_num_threads(3)
    yield
    assert torch.get_num_threads() == 3
    torch.set_num_threads(before)


def test_results_come_in_the_order_of_the_items_each_computed_on_one_thread(three_threads):
    seen = list(map_on_threads(lambda item: (item, torch.get_num_threads()), range(20)))
    assert seen == [(item, 1) for item in range(20)]


def test_an_error_on_a_thread_is_an_error(three_threads):
    with pytest.raises(ZeroDivisionError):
        list(map_on_threads(lambda item: 1 // item, [2, 1, 0, 3]))


def test_affinities_are_summed_as_by_a_plain_loop():
    random = np.random.default_rng(0)
    labels = random.integers(0, 9, (30, 41)).astype(np.int32)
    affinity = random.random((len(OFFSETS), 30, 41)).astype(np.float32)
    within, pairs, between = np.zeros((9, 8)), {}, {}
    for channel, (dy, dx) in enumerate(OFFSETS):
        for y in range(30 - dy):
            for x in range(max(0, -dx), 41 - max(0, dx)):
                a, b = sorted((int(labels[y, x]), int(labels[y + dy, x + dx])))
                row = within[a] if a == b else between.setdefault((a, b), np.zeros(8))
                row[GROUP[channel]] += affinity[channel, y, x]
                row[4 + GROUP[channel]] += 1
    pairs = sorted(between)
    found = affinities_of(labels, affinity)
    np.testing.assert_allclose(found[0], within)
    np.testing.assert_array_equal(found[1], pairs)
    np.testing.assert_allclose(found[2], [between[pair] for pair in pairs])


def test_a_table_of_pairs_grows_when_it_is_full(monkeypatch):
    monkeypatch.setattr(regions, "ROOM", 1)
    labels = np.random.default_rng(0).permutation(3600).reshape(60, 60).astype(np.int32)
    _, pairs, between = affinities_of(labels, np.ones((len(OFFSETS), 60, 60), np.float32))
    assert len(pairs) == sum((60 - dy) * (60 - abs(dx)) for dy, dx in OFFSETS)
    assert (between.sum(0)[:4] == between.sum(0)[4:]).all()


@pytest.mark.parametrize("count", [0, 7])
def test_pixels_of_regions_are_listed(count):
    labels = np.random.default_rng(0).integers(-1, max(count - 1, 0), (20, 31)).astype(np.int32)  # the last has none
    lists = group_pixels(labels, count)
    assert len(lists) == count
    for number, pixels in enumerate(lists):
        np.testing.assert_array_equal(pixels, np.flatnonzero(labels == number))


@torch.no_grad()
def test_the_network_frees_what_it_has_put_together():
    network, seen, alive = StrokeNetwork().eval(), [], []
    network.down[0].register_forward_hook(lambda _module, _inputs, out: seen.append(weakref.ref(out)))
    network.up[0].register_forward_pre_hook(lambda *_: alive.append(seen[0]() is not None))
    network(torch.zeros(1, 3, 32, 32))
    assert alive == [False]


def test_memory_is_given_back_until_curves_are_fitted(monkeypatch):
    calls, refine = [], recover.refine
    monkeypatch.setattr(threads, "keep_memory", lambda *most: calls.append(most))
    monkeypatch.setattr(recover, "refine", lambda *args, **words: calls.append("refined") or refine(*args, **words))
    recover.recover_with(RecoveryModel().eval(), np.full((48, 48, 3), 0.5, np.float32), 1.0, 1, lambda *_: None)
    assert calls == [(threads.KEPT_ARRAY,), "refined", ()]


@pytest.mark.skipif(sys.platform != "linux", reason="reads how much memory is used from /proc")
def test_maps_take_no_memory_while_the_network_looks():
    def used() -> float:
        return int(Path("/proc/self/statm").read_text().split()[1]) * 4096 / 2**20

    def looks(x):
        grown.append(used() - before)
        return torch.zeros(1, CHANNELS, *x.shape[2:])

    image, grown = np.zeros((1024, 1024, 3), np.float32), []
    with return_freed_memory():
        before = used()
        predict(looks, image, 1)
    assert grown[0] < 60  # the maps take 120
