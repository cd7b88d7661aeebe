"""Place strokes in levels, from large to small cells, where the error of the canvas so far is largest."""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn.functional import adaptive_avg_pool2d, avg_pool2d, interpolate

from brushexp.contracts.strokes import Strokes
from brushexp_predictor.lay.decoding import Form, areas_of, draw, strokes_of
from brushexp_predictor.lay.network import CELL, CellPredictions

CELL_SIZES = (6.0, 3.0, 1.5, 0.75, 0.55)  # side of the cells of each level, in stroke spacings
SHARES = (1.0, 1.0, 0.2, 0.4, 1.0)  # maximum share of all strokes in each level

Look = Callable[[Tensor, Tensor], CellPredictions]  # a function like `StrokePredictor.forward`


class Level(NamedTuple):
    """A lattice of cells, some of which receive a stroke."""

    rows: int
    columns: int
    keep: int  # number of strokes to lay


class Cells(NamedTuple):
    """Data about cells: a lattice in each of B pictures (B, rows, columns, ...), or K cells of one picture (K, ...)."""

    numbers: Tensor  # (..., 11), predicted or sampled
    deviations: Tensor  # (..., 11), logarithms
    worth: Tensor  # (...), log-odds of the predicted share of the error that a stroke removes
    errors: Tensor  # (...), mean squared error before the stroke
    means: Tensor  # (..., 3), mean colour of the target
    gains: Tensor  # (...), predicted decrease of the error, weighted by the focus


@dataclass(frozen=True)
class Laid:
    """A picture's canvas after a level."""

    form: Form
    strokes: Strokes  # bottom to top, in pixels of the target
    background: Tensor  # (3,)
    size: tuple[int, int]  # size of the canvas, which is no larger than the input of the next level
    zoom: float  # pixels of the canvas per pixel of the target
    places: Tensor  # (K,) numbers of the cells that got a stroke in this level, row by row
    cells: Cells  # data about these cells

    @cached_property
    def canvas(self) -> Tensor:
        """The strokes, drawn as a picture (3, h, w)."""
        strokes = self.strokes.moved(zoom=self.zoom) if self.zoom < 1 else self.strokes
        return draw(self.form, strokes, self.size, self.background)


def levels_of(size: tuple[int, int], n: int) -> list[Level]:
    """Plan the levels for exactly ``n`` strokes on a canvas of ``size`` (H, W)."""
    pitch, levels, rest = math.sqrt(size[0] * size[1] / n), [], n
    for side, share in zip(CELL_SIZES, SHARES, strict=True):
        rows, columns = (max(1, round(length / (side * pitch))) for length in size)
        keep = min(rest, rows * columns, max(1, round(share * n)))
        levels += [Level(rows, columns, keep)] if keep else []
        rest -= keep
    while rest:  # a strip narrower than its cells may have fewer cells than strokes
        levels.append(levels[-1]._replace(keep=min(rest, levels[-1].rows * levels[-1].columns)))
        rest -= levels[-1].keep
    return levels


def lay(
    network: Look,
    form: Form,
    targets: Sequence[Tensor],
    levels: Sequence[Level],
    generator: torch.Generator | None = None,
    temperature: float = 0.0,
    focus: Tensor | None = None,
) -> Iterator[list[Laid]]:
    """Place strokes for several targets (3, H, W) in the same levels; yield all canvases after each level.

    ``focus`` (H, W) weights the pixels when cells are chosen for strokes. Gradients flow from a level's canvas to the
    strokes in that level and earlier levels, but not through the canvases that the network receives.
    """
    done = [blank_canvas(target, form, levels[0]) for target in targets]
    for level, following in zip(levels, [*levels[1:], None], strict=True):
        shape = (CELL * level.rows, CELL * level.columns)
        seen = torch.stack([resize_picture(target, shape) for target in targets])
        canvas = torch.stack([resize_picture(laid.canvas.detach(), shape) for laid in done])
        numbers, deviations, worth = network(seen, canvas)
        if temperature:
            noise = torch.randn(numbers.shape, generator=generator, dtype=numbers.dtype)
            numbers = numbers + temperature * deviations.exp() * noise
        errors = errors_of(seen, canvas)
        gains = errors * worth.detach().sigmoid()
        if focus is not None:
            gains = gains * adaptive_avg_pool2d(focus[None], (level.rows, level.columns))
        means = avg_pool2d(seen, CELL).permute(0, 2, 3, 1)
        cells = Cells(numbers, deviations, worth, errors, means, gains)
        done = [
            with_level(laid, target, level, following, Cells(*(values[k].flatten(0, 1) for values in cells)))
            for k, (laid, target) in enumerate(zip(done, targets, strict=True))
        ]
        yield done


def blank_canvas(target: Tensor, form: Form, first: Level) -> Laid:
    """Make an empty canvas in the mean colour of a target (3, H, W)."""
    none = target.new_empty(0)
    return Laid(form, Strokes.none(target), target.mean((1, 2)), *view_of(target, first), none, Cells(*6 * [none]))


def with_level(laid: Laid, target: Tensor, level: Level, following: Level | None, cells: Cells) -> Laid:
    """Add a level's strokes where the expected gain is largest, with large strokes below small ones."""
    places = cells.gains.topk(level.keep).indices.sort().values
    own = Cells(*(values[places] for values in cells))
    height, width = target.shape[1] / level.rows, target.shape[2] / level.columns
    row, column = places // level.columns, places % level.columns
    middle = torch.stack([(column + 0.5) * width, (row + 0.5) * height], 1).to(target)
    new = strokes_of(laid.form, own.numbers, own.means, middle, math.sqrt(height * width))
    strokes = Strokes.join(laid.strokes, new[areas_of(new.map(Tensor.detach)).argsort(descending=True)])
    return Laid(laid.form, strokes, laid.background, *view_of(target, following), places, own)


def view_of(target: Tensor, level: Level | None) -> tuple[tuple[int, int], float]:
    """Return the size and zoom of a level's input canvas or, after the last level, of the target."""
    height, width = target.shape[1:]
    zoom = 1.0 if level is None else min(1.0, CELL * math.sqrt(level.rows * level.columns / (height * width)))
    return (max(1, round(height * zoom)), max(1, round(width * zoom))), zoom


def errors_of(seen: Tensor, canvas: Tensor) -> Tensor:
    """Compute the squared error (B, H, W) between pictures and canvases, averaged over the pixels of each cell."""
    return avg_pool2d((seen - canvas).square().sum(1), CELL)


def resize_picture(picture: Tensor, size: tuple[int, int]) -> Tensor:
    """Resample a picture (3, H, W) to a size, bilinearly and with antialiasing."""
    if tuple(picture.shape[1:]) == size:
        return picture
    return interpolate(picture[None], size, mode="bilinear", antialias=True, align_corners=False)[0]
