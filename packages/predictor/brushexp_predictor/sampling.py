"""Several paintings of one picture, from one network."""

from collections.abc import Iterator
from typing import NamedTuple

import torch
from torch import Tensor

from brushexp.pictures.similarity import psnr_of
from brushexp.strokes.catalogue import Strokes
from brushexp_predictor.colors import ROUNDS
from brushexp_predictor.decoding import Form
from brushexp_predictor.drawing import draw
from brushexp_predictor.network import StrokePredictor
from brushexp_predictor.predicting import in_best_colors, predict

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
    for number in range(count):
        generator = torch.Generator().manual_seed(1_000_003 * seed + number)
        *_, strokes = predict(network, target, n, generator, temperature)
        yield sample_of(network.form, in_best_colors(network, strokes, target, ROUNDS), target)


@torch.no_grad()
def sample_of(form: Form, strokes: Strokes, target: Tensor) -> Sample:
    """Draw strokes on the mean colour of a target (3, H, W), and compare."""
    painting = draw(form, strokes, (target.shape[1], target.shape[2]), target.mean((1, 2)))
    return Sample(strokes, painting, psnr_of(float((painting - target).square().mean())))
