"""Several paintings of one picture, from one network."""

from collections.abc import Iterator
from typing import NamedTuple

import torch
from torch import Tensor

from brushexp.pictures.similarity import psnr_of
from brushexp.strokes.catalogue import Strokes
from brushexp_predictor.colors import best_colors
from brushexp_predictor.drawing import draw_plain
from brushexp_predictor.network import StrokePredictor
from brushexp_predictor.predicting import predict

ROUNDS = 2  # of the search for the best colours
TEMPERATURE = 1.0  # strokes vary as much as the network says


class Sample(NamedTuple):
    """One painting of a picture."""

    strokes: Strokes  # the lowest first, in pixels
    painting: Tensor  # (3, H, W)
    psnr: float  # dB, of the painting


def paint_samples(
    network: StrokePredictor, target: Tensor, n: int, count: int, seed: int = 0, temperature: float = TEMPERATURE
) -> Iterator[Sample]:
    """Paint a target (3, H, W) ``count`` times with ``n`` strokes, each time with other numbers drawn for them."""
    size, background = (target.shape[1], target.shape[2]), target.mean((1, 2))
    for number in range(count):
        generator = torch.Generator().manual_seed(1_000_003 * seed + number)
        *_, strokes = predict(network, target, n, generator, temperature)
        strokes = best_colors(strokes, target, lambda laid: draw_plain(laid, size, background), ROUNDS)
        yield sample_of(strokes, target)


@torch.no_grad()
def sample_of(strokes: Strokes, target: Tensor) -> Sample:
    """Draw strokes on the mean colour of a target (3, H, W), and compare."""
    painting = draw_plain(strokes, (target.shape[1], target.shape[2]), target.mean((1, 2)))
    return Sample(strokes, painting, psnr_of(float((painting - target).square().mean())))
