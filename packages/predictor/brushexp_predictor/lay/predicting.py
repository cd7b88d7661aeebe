"""Paint pictures of any size with an exact number of strokes; the network processes large pictures in parts."""

from collections.abc import Iterator
from typing import NamedTuple

import torch
from torch import Tensor

from brushexp.contracts.pictures import psnr_of
from brushexp.contracts.strokes import Strokes
from brushexp_predictor.lay.colors import ROUNDS, best_colors
from brushexp_predictor.lay.decoding import Form, draw
from brushexp_predictor.lay.network import CELL, RECEPTIVE_FIELD, CellPredictions, StrokePredictor
from brushexp_predictor.lay.pyramid import Look, lay, levels_of

TILE_CELLS = 256  # side in cells of the parts of a picture that the network processes
TEMPERATURE = 1.0  # strokes of samples vary as much as the network predicts


class Sample(NamedTuple):
    """One of several paintings of a picture."""

    strokes: Strokes  # bottom to top, in pixels
    painting: Tensor  # (3, H, W)
    psnr: float  # PSNR of the painting in dB


@torch.no_grad()
def predict(
    network: StrokePredictor,
    target: Tensor,
    n: int,
    generator: torch.Generator | None = None,
    temperature: float = 0.0,
    focus: Tensor | None = None,
) -> Iterator[Strokes]:
    """Paint a target (3, H, W) with ``n`` strokes on its mean colour; yield the strokes so far after each level.

    Args:
        network: frozen network.
        target: picture in [0, 1].
        n: total number of strokes.
        generator: source of all randomness.
        temperature: random variation in the strokes' parameters, in units of the predicted deviations; 0 = none.
        focus: pixel weights (H, W) with a mean of 1; high weights attract strokes.
    """
    in_parts = in_tiles(network)
    levels = levels_of((target.shape[1], target.shape[2]), n)
    for done in lay(in_parts, network.form, [target], levels, generator, temperature, focus):
        yield done[0].strokes.map(Tensor.contiguous)


def with_best_colors(network: StrokePredictor, strokes: Strokes, target: Tensor, rounds: int) -> Strokes:
    """Replace the strokes' colours with those that, drawn by the network's renderer, best match a target (3, H, W)."""
    size, background = (target.shape[1], target.shape[2]), target.mean((1, 2))
    return best_colors(strokes, target, lambda drawn: draw(network.form, drawn, size, background), rounds)


def paint_samples(
    network: StrokePredictor, target: Tensor, n: int, count: int, seed: int = 0, temperature: float = TEMPERATURE
) -> Iterator[Sample]:
    """Paint a target (3, H, W) ``count`` times, each time with ``n`` strokes and different random numbers."""
    for number in range(count):
        generator = torch.Generator().manual_seed(1_000_003 * seed + number)
        *_, strokes = predict(network, target, n, generator, temperature)
        yield sample_of(network.form, with_best_colors(network, strokes, target, ROUNDS), target)


@torch.no_grad()
def sample_of(form: Form, strokes: Strokes, target: Tensor) -> Sample:
    """Draw strokes on the mean colour of a target (3, H, W), and measure the painting's PSNR."""
    painting = draw(form, strokes, (target.shape[1], target.shape[2]), target.mean((1, 2)))
    return Sample(strokes, painting, psnr_of(float((painting - target).square().mean())))


def in_tiles(network: StrokePredictor) -> Look:
    """Wrap a network so that it processes large pictures part by part, with the same output as in a single pass."""

    def look(target: Tensor, canvas: Tensor) -> CellPredictions:
        rows, columns = target.shape[2] // CELL, target.shape[3] // CELL
        if max(rows, columns) <= TILE_CELLS + 2 * RECEPTIVE_FIELD:
            return network(target, canvas)
        bands = []
        for band in map(_spans, range(0, rows, TILE_CELLS)):
            parts = []
            for part in map(_spans, range(0, columns, TILE_CELLS)):
                (seen_rows, own_rows), (seen_columns, own_columns) = band, part
                told = network(target[..., seen_rows, seen_columns], canvas[..., seen_rows, seen_columns])
                parts.append([values[:, own_rows, own_columns] for values in told])
            bands.append([torch.cat(values, 2) for values in zip(*parts, strict=True)])
        return CellPredictions(*(torch.cat(values, 1) for values in zip(*bands, strict=True)))

    return look


def _spans(first: int) -> tuple[slice, slice]:
    """Return the pixels needed for the part that begins at cell ``first``, and the part's own cells within them."""
    begin = max(0, first - RECEPTIVE_FIELD)
    end = first + TILE_CELLS + RECEPTIVE_FIELD
    return slice(CELL * begin, CELL * end), slice(first - begin, first - begin + TILE_CELLS)
