"""The maps of the network for a picture: the mean over turned and mirrored copies, turned back."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn.functional import pad

from brushexp_recovery.network import AFFINE, CENTRE, CHANNELS, GEOMETRY, OFFSETS, OVER, STRIDE, TURN, StrokeNetwork
from brushexp_recovery.raster.offsets import shift

Array = NDArray[Any]
Offset = tuple[int, int]

COPIES = (  # quarters, mirror
    *((0, False), (1, True), (2, False), (3, True)),
    *((1, False), (2, True), (3, False), (0, True)),
)


@dataclass(frozen=True)
class Maps:
    """What the network says of a picture (H, W); the geometry is as in `network.StrokeNetwork`."""

    affinity: Array  # (`AFFINE`, H, W) float32 in [0, 1]
    geometry: Array  # (`GEOMETRY`, H, W) float32
    over: Array  # (len(`OVER`), H, W) float32, log-odds


@torch.no_grad()
def predict(network: StrokeNetwork, image: Array, copies: int = 2, first: int = 0) -> Maps:
    """Look at a picture (H, W, 3) float32 in [0, 1], in so many of its `COPIES`, from the ``first`` on.

    In 16 bits where these are faster.
    """
    height, width = image.shape[:2]
    x = torch.from_numpy(np.ascontiguousarray(image.transpose(2, 0, 1), np.float32))[None]
    x = pad(x, (0, -width % STRIDE, 0, -height % STRIDE), mode="replicate")
    total = torch.from_numpy(np.zeros((1, CHANNELS, *x.shape[2:]), np.float32))  # takes no memory until it is written
    able = torch.cpu._is_avx512_bf16_supported()  # without it 16 bits take six to twelve times as long
    for quarters, mirrored in (COPIES[(first + k) % len(COPIES)] for k in range(copies)):
        copy = torch.rot90(x, quarters, (2, 3))
        copy = copy.flip(3) if mirrored else copy
        with torch.autocast("cpu", torch.bfloat16, enabled=able):
            told = network(copy.contiguous(memory_format=torch.channels_last))
        add_turned_back(total, told, quarters, mirrored)
    mean = total.div_(copies)[0, :, :height, :width].numpy()
    return Maps(mean[:AFFINE], mean[AFFINE : AFFINE + GEOMETRY], mean[AFFINE + GEOMETRY :])


def add_turned_back(total: Tensor, told: Tensor, quarters: int, mirrored: bool) -> None:
    """Add the maps of a copy to ``total``, turned back: places, and what offsets and directions mean.

    Affinities become probabilities.
    """
    told = told.flip(3) if mirrored else told
    told = torch.rot90(told, -quarters, (2, 3))
    affinity, geometry, over = told.split([AFFINE, GEOMETRY, len(OVER)], 1)
    _add_reassigned(total[:, :AFFINE], affinity.float().sigmoid_(), OFFSETS, quarters, mirrored, 1.0)
    _add_reassigned(total[:, AFFINE + GEOMETRY :], over.float(), OVER, quarters, mirrored, -1.0)
    geometry = geometry.float()
    x, y = geometry[:, CENTRE].unbind(1)
    cosine, sine = geometry[:, TURN].unbind(1)
    if mirrored:
        x, sine = -x, -sine
    for _ in range(quarters):
        x, y, cosine, sine = -y, x, -cosine, -sine
    turned = {CENTRE.start: x, CENTRE.start + 1: y, TURN.start: cosine, TURN.start + 1: sine}
    for channel in range(GEOMETRY):
        total[:, AFFINE + channel] += turned.get(channel, geometry[:, channel])


def _add_reassigned(
    total: Tensor, values: Tensor, offsets: tuple[Offset, ...], quarters: int, mirrored: bool, sign: float
) -> None:
    """Add what a copy says of its offsets to those of the picture, times ``sign`` if seen from the other end."""
    for channel, (dy, dx) in enumerate(offsets):
        row, column = dy, -dx if mirrored else dx
        for _ in range(quarters):
            row, column = column, -row
        if (row, column) in offsets:
            total[:, offsets.index((row, column))] += values[:, channel]
        else:  # stored at the pixel that it leads to
            total[:, offsets.index((-row, -column))] += sign * shift(values[:, channel], -row, -column)
