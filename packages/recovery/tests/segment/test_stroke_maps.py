"""Test that maps of rotated copies are transformed back, and that the memory of large pictures is freed."""

import sys
import weakref
from pathlib import Path

import numpy as np
import pytest
import torch
from brushexp_recovery.model.channels import (
    AFFINITY,
    AFFINITY_OFFSETS,
    ATTRIBUTES,
    CENTRE,
    CENTRE_UNIT,
    CHANNELS,
    DIRECTION,
    OCCLUSION,
    OCCLUSION_OFFSETS,
)
from brushexp_recovery.model.unet import StrokeNetwork
from brushexp_recovery.raster.threads import return_freed_memory
from brushexp_recovery.segment.affinity_maps import predict_maps


class Oracle(torch.nn.Module):
    """A network that returns the true maps of a picture whose red channel is the stroke number divided by ten."""

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        labels = (x[0, 0] * 10).round().long()
        out = torch.zeros(1, CHANNELS, *labels.shape)
        for channel, (dy, dx) in enumerate(AFFINITY_OFFSETS):
            there = torch.roll(labels, (-dy, -dx), (0, 1))
            out[0, AFFINITY][channel] = 40.0 * (there == labels) - 20
        for channel, (dy, dx) in enumerate(OCCLUSION_OFFSETS):
            there = torch.roll(labels, (-dy, -dx), (0, 1))
            out[0, OCCLUSION][channel] = (there > labels).float() - (there < labels).float()
        rows, columns = torch.meshgrid(*(torch.arange(n) + 0.5 for n in labels.shape), indexing="ij")
        for number in labels.unique():
            own = labels == number
            place = torch.stack([columns[own], rows[own]])
            out[0, ATTRIBUTES][CENTRE][:, own] = (place.mean(1)[:, None] - place) / CENTRE_UNIT
            xx, yy, xy = (c.item() for c in (place[0].var(), place[1].var(), torch.cov(place)[0, 1]))
            out[0, ATTRIBUTES][DIRECTION][:, own] = torch.tensor([[xx - yy], [2 * xy]])
        return out


def test_maps_of_turned_copies_say_the_same():
    labels = torch.zeros(64, 96)
    labels[10:50, 10:30], labels[20:40, 25:80], labels[45:60, 50:58] = 3, 5, 2
    image = np.stack([labels.numpy() / 10] * 3, 2).astype(np.float32)
    one, eight = predict_maps(Oracle(), image, 1), predict_maps(Oracle(), image, 8)
    inner = np.s_[..., 20:-20, 20:-20]  # the oracle wraps around at borders
    for name in ("affinity", "paint", "attributes", "occlusion"):
        np.testing.assert_allclose(getattr(eight, name)[inner], getattr(one, name)[inner], rtol=1e-3, atol=1e-3)


@torch.no_grad()
def test_the_network_frees_what_it_has_concatenated():
    network, outputs, alive = StrokeNetwork().eval(), [], []
    network.down[0].register_forward_hook(lambda _module, _inputs, out: outputs.append(weakref.ref(out)))
    network.up[0].register_forward_pre_hook(lambda *_: alive.append(outputs[0]() is not None))
    network(torch.zeros(1, 3, 32, 32))
    assert alive == [False]


@pytest.mark.skipif(sys.platform != "linux", reason="reads memory usage from /proc")
def test_maps_take_no_memory_while_the_network_looks():
    def used() -> float:
        return int(Path("/proc/self/statm").read_text().split()[1]) * 4096 / 2**20

    def look(x):
        grown.append(used() - before)
        return torch.zeros(1, CHANNELS, *x.shape[2:])

    image, grown = np.zeros((1024, 1024, 3), np.float32), []
    with return_freed_memory():
        before = used()
        predict_maps(look, image, 1)
    assert grown[0] < 60  # the maps need 120
