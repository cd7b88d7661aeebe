"""What activations see: against known fields, cheaply, and once."""

from functools import partial

import pytest
import torch
from networks import alexnet_state, saved, squeeze_state, vgg_state
from torch.testing import assert_close

from brushexp.features import open_backbone, sight
from brushexp.features.sight import activations_of, aligned, sight_of, tiles
from brushexp.pictures.region import Region

STATES = {"alexnet": alexnet_state, "squeeze": squeeze_state, "vgg16": vgg_state}


@pytest.mark.parametrize(
    ("name", "tap", "field", "stride"),
    [
        ("effl0", "stem", 3, 2),
        ("effl0", "b0", 7, 2),
        ("effl0", "b2", 19, 4),
        ("effl0", "b3.expand", 19, 4),
        ("effl0", "b4", 67, 8),
        ("effl0", "b8.expand", 147, 16),
        ("alexnet", "relu1", 11, 4),
        ("alexnet", "relu3", 99, 16),
        ("squeeze", "relu1", 3, 2),
        ("squeeze", "fire5", 63, 8),
        ("vgg16", "relu1_2", 5, 1),
        ("vgg16", "relu3_1", 24, 4),
    ],
)
def test_the_field_of_view_is_found(tmp_path, name, tap, field, stride):
    weights = str(saved(tmp_path, STATES[name]())) if name in STATES else None
    found = sight_of(open_backbone(name, weights), [tap])
    assert (found.field, found.strides) == (field, (stride,))
    assert found.before + found.after >= field - 1


def test_it_is_found_out_once_and_moves_no_random_numbers(monkeypatch):
    calls = []
    monkeypatch.setattr(sight, "_look", lambda *args, look=sight._look: calls.append(args[1]) or look(*args))
    before = torch.get_rng_state()
    first, second = open_backbone("effl0"), open_backbone("effl0")
    found = [sight_of(network, taps) for network in (first, second, first) for taps in (["stem"], ["b0", "b2"])]
    assert calls == [["stem"], ["b0", "b2"]] * 2
    assert found[:2] == found[2:4] == found[4:]
    assert found[0] is found[4]
    assert torch.equal(torch.get_rng_state(), before)


@pytest.mark.parametrize("grid", [1, 2, 4, 16])
def test_aligned_parts_begin_on_the_grid_and_are_padded_as_the_whole(grid):
    for size in ((37, 90), (64, 33), (5, 200)):
        for region in (Region(0, 0, 3, 7), Region(2, 30, 3, 1), Region(size[0] - 2, size[1] - 5, 2, 5)):
            for margin in (0, 3, 40):
                part = aligned(region, size, margin, margin, grid)
                wide = region.widened(margin, size)
                assert part.top % grid == part.left % grid == 0
                assert (size[0] - part.height) % grid == (size[1] - part.width) % grid == 0
                assert 0 <= part.top <= wide.top
                assert 0 <= part.left <= wide.left
                assert wide.top + wide.height <= part.top + part.height <= size[0]
                assert wide.left + wide.width <= part.left + part.width <= size[1]
                assert part.height < wide.height + 2 * grid
                assert part == wide or grid > 1


def test_tiles_hold_every_activation_once(monkeypatch):
    monkeypatch.setattr(sight, "TILE", 32)
    network, taps, size = open_backbone("effl0"), ["stem", "b2", "b4"], (77, 101)
    seen = sight_of(network, taps)
    picture = torch.rand(3, *size)
    wanted = network(picture[None], taps)
    cut = partial(Region.of, picture=picture)
    parts = [activations_of(network, taps, seen, zone, size, cut) for zone in tiles(Region(0, 0, *size))]
    for tap, pieces in zip(taps, zip(*parts, strict=True), strict=True):
        found, all_of = torch.cat(pieces, 1), wanted[tap][0].flatten(1)
        assert found.shape == all_of.shape
        assert_close(found.sort(1).values, all_of.sort(1).values, rtol=1e-4, atol=1e-4)
