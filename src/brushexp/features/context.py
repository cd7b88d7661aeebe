"""Activations of large pictures, part by part, each part with the context that the network needs around it."""

import math
from collections.abc import Iterator, Sequence

from torch import Tensor

from brushexp.features.base import Backbone
from brushexp.pictures.region import Region

TILE_PIXELS = 512  # side of the tiles: bounds the memory of a picture of any size


def tiled_activations(network: Backbone, taps: Sequence[str], picture: Tensor) -> Iterator[list[Tensor]]:
    """Activations (C, positions) of each tap for a picture (3, H, W), tile by tile.

    Each tile is looked at with ``network.context`` pixels around it, of which the activations are then cut off.
    """
    size = (picture.shape[1], picture.shape[2])
    for tile in Region.whole(picture).tiles(TILE_PIXELS):
        frame = tile.widened(network.context, size, network.grid)
        found = network(frame.of(picture)[None], taps)
        yield [_cropped(found[tap][0], frame, tile).flatten(1) for tap in taps]


def _cropped(features: Tensor, frame: Region, tile: Region) -> Tensor:
    """The positions of features (C, h, w) of a frame that lie in a tile of it."""
    rows = _positions(tile.top - frame.top, tile.height, frame.height, features.shape[1])
    columns = _positions(tile.left - frame.left, tile.width, frame.width, features.shape[2])
    return features[:, rows, columns]


def _positions(first: int, length: int, side: int, n: int) -> slice:
    """Which of ``n`` positions over a ``side`` lie in a span of it.

    Their stride is a power of two, which divides the span's begin, and its end unless that is the end of the side.
    """
    stride = 2 ** round(math.log2(side / n))
    return slice(first // stride, n if first + length == side else (first + length) // stride)
