"""Predict the maps of a picture with the network, averaged over rotated and mirrored copies."""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn.functional import pad

from brushexp_recovery.model.channels import (
    AFFINITY,
    AFFINITY_OFFSETS,
    ATTRIBUTES,
    CHANNELS,
    OCCLUSION,
    OCCLUSION_OFFSETS,
    PAINT,
    StrokeAttribute,
)
from brushexp_recovery.model.unet import STRIDE, StrokeNetwork
from brushexp_recovery.raster.offsets import Offset, shift

Array = NDArray[Any]


class Copy(NamedTuple):
    """A copy of a picture, rotated anticlockwise by quarter turns and then mirrored."""

    quarters: int
    mirrored: bool


COPIES = (
    Copy(0, False),
    Copy(1, True),
    Copy(2, False),
    Copy(3, True),
    Copy(1, False),
    Copy(2, True),
    Copy(3, False),
    Copy(0, True),
)


@dataclass(frozen=True)
class StrokeMaps:
    """The network's prediction for a picture (H, W); see `unet.StrokeNetwork`."""

    affinity: Array  # (len(AFFINITY_OFFSETS), H, W) float32 in [0, 1]
    paint: Array  # (H, W) float32, log-odds
    attributes: Array  # (len(StrokeAttribute), H, W) float32
    occlusion: Array  # (len(OCCLUSION_OFFSETS), H, W) float32, log-odds


@torch.no_grad()
def predict_maps(network: StrokeNetwork, image: Array, copies: int = 2, first: int = 0) -> StrokeMaps:
    """Predict the maps of a picture (H, W, 3) float32 in [0, 1] as the mean over some of its `COPIES`.

    ``first`` is the index of the first copy; the others follow in order. The network computes in 16 bits if the
    processor supports it efficiently.
    """
    height, width = image.shape[:2]
    x = torch.from_numpy(np.ascontiguousarray(image.transpose(2, 0, 1), np.float32))[None]
    x = pad(x, (0, -width % STRIDE, 0, -height % STRIDE), mode="replicate")
    total = torch.from_numpy(np.zeros((1, CHANNELS, *x.shape[2:]), np.float32))  # uses no memory until it is written
    has_bfloat16 = torch.cpu._is_avx512_bf16_supported()  # without it 16 bits take six to twelve times as long
    for number in range(first, first + copies):
        copy = COPIES[number % len(COPIES)]
        turned = torch.rot90(x, copy.quarters, (2, 3))
        turned = turned.flip(3) if copy.mirrored else turned
        with torch.autocast("cpu", torch.bfloat16, enabled=has_bfloat16):
            output = network(turned.contiguous(memory_format=torch.channels_last))
        _add_turned_back(total, output, copy)
    mean = total.div_(copies)[0, :, :height, :width].numpy()
    return StrokeMaps(mean[AFFINITY], mean[PAINT], mean[ATTRIBUTES], mean[OCCLUSION])


def _add_turned_back(total: Tensor, output: Tensor, copy: Copy) -> None:
    """Transform the positions, offsets and directions in a copy's maps back to the picture; add the maps to ``total``.

    Affinities are converted to probabilities.
    """
    output = output.flip(3) if copy.mirrored else output
    output = torch.rot90(output, -copy.quarters, (2, 3))
    _add_by_offset(total[:, AFFINITY], output[:, AFFINITY].float().sigmoid_(), AFFINITY_OFFSETS, copy, 1.0)
    _add_by_offset(total[:, OCCLUSION], output[:, OCCLUSION].float(), OCCLUSION_OFFSETS, copy, -1.0)
    total[:, PAINT] += output[:, PAINT].float()
    attributes = output[:, ATTRIBUTES].float()
    x, y = attributes[:, StrokeAttribute.CENTRE_X], attributes[:, StrokeAttribute.CENTRE_Y]
    cosine, sine = attributes[:, StrokeAttribute.COSINE], attributes[:, StrokeAttribute.SINE]
    if copy.mirrored:
        x, sine = -x, -sine
    for _ in range(copy.quarters):
        x, y, cosine, sine = -y, x, -cosine, -sine
    turned = {
        StrokeAttribute.CENTRE_X: x,
        StrokeAttribute.CENTRE_Y: y,
        StrokeAttribute.COSINE: cosine,
        StrokeAttribute.SINE: sine,
    }
    for attribute in StrokeAttribute:
        total[:, ATTRIBUTES.start + attribute] += turned.get(attribute, attributes[:, attribute])


def _add_by_offset(total: Tensor, values: Tensor, offsets: tuple[Offset, ...], copy: Copy, sign: float) -> None:
    """Add a copy's maps to the picture's maps; if an offset must be reversed, multiply its map by ``sign``."""
    for channel, (dy, dx) in enumerate(offsets):
        row, column = dy, -dx if copy.mirrored else dx
        for _ in range(copy.quarters):
            row, column = column, -row
        if (row, column) in offsets:
            total[:, offsets.index((row, column))] += values[:, channel]
        else:  # stored at the pixel to which it points
            total[:, offsets.index((-row, -column))] += sign * shift(values[:, channel], -row, -column)
