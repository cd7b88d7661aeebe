"""Pictures of any size are looked at in parts, and painted with exactly as many strokes as asked."""

from collections.abc import Iterator

import torch
from torch import Tensor

from brushexp.strokes.catalogue import Strokes
from brushexp_predictor.colors import best_colors
from brushexp_predictor.drawing import draw
from brushexp_predictor.network import CELL, REACH, StrokePredictor, Told
from brushexp_predictor.pyramid import Look, lay, levels_of

PART = 256  # cells: sides of the parts of a picture that the network looks at


@torch.no_grad()
def predict(
    network: StrokePredictor,
    target: Tensor,
    n: int,
    generator: torch.Generator | None = None,
    temperature: float = 0.0,
    focus: Tensor | None = None,
) -> Iterator[Strokes]:
    """Paint a target (3, H, W) with ``n`` strokes on its mean colour: those laid so far, the lowest first, by level.

    Args:
        network: frozen.
        target: in [0, 1].
        n: strokes that the last level ends with.
        generator: of all that is random.
        temperature: deviations by which numbers of strokes vary, in those that the network says; 0 for none.
        focus: (H, W) weights of the pixels, of mean 1: where strokes go.
    """
    in_parts = partly(network)
    levels = levels_of((target.shape[1], target.shape[2]), n)
    for done in lay(in_parts, network.form, [target], levels, generator, temperature, focus):
        yield done[0].strokes.map(Tensor.contiguous)


def in_best_colors(network: StrokePredictor, strokes: Strokes, target: Tensor, rounds: int) -> Strokes:
    """Give strokes the colours that suit a target (3, H, W) best, as the network's renderer draws them."""
    size, background = (target.shape[1], target.shape[2]), target.mean((1, 2))
    return best_colors(strokes, target, lambda drawn: draw(network.form, drawn, size, background), rounds)


def partly(network: StrokePredictor) -> Look:
    """Let a network look at large pictures part by part; what it says is the same as of the whole."""

    def look(target: Tensor, canvas: Tensor) -> Told:
        rows, columns = target.shape[2] // CELL, target.shape[3] // CELL
        if max(rows, columns) <= PART + 2 * REACH:
            return network(target, canvas)
        bands = []
        for top in range(0, rows, PART):
            row = [_part(network, target, canvas, top, left) for left in range(0, columns, PART)]
            bands.append(Told(*(torch.cat(parts, 2) for parts in zip(*row, strict=True))))
        return Told(*(torch.cat(parts, 1) for parts in zip(*bands, strict=True)))

    return look


def _part(network: StrokePredictor, target: Tensor, canvas: Tensor, top: int, left: int) -> Told:
    """Look at the cells from (top, left) on, with as many around them as matter to them."""
    first_row, first_column = max(0, top - REACH), max(0, left - REACH)
    around = (
        ...,
        slice(CELL * first_row, CELL * (top + PART + REACH)),
        slice(CELL * first_column, CELL * (left + PART + REACH)),
    )
    told = network(target[around], canvas[around])
    rows, columns = (
        slice(top - first_row, top - first_row + PART),
        slice(left - first_column, left - first_column + PART),
    )
    return Told(*(values[:, rows, columns] for values in told))
