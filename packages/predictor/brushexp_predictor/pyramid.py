"""Strokes are laid in levels from large cells to small ones, each where the canvas so far is worst."""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn.functional import adaptive_avg_pool2d, avg_pool2d, interpolate

from brushexp.strokes.catalogue import Strokes
from brushexp_predictor.decoding import Form, areas_of, strokes_of
from brushexp_predictor.drawing import draw
from brushexp_predictor.network import CELL, Told

SIZES = (6.0, 3.0, 1.5, 0.75, 0.5)  # sides of the cells of the levels, in mean distances between strokes
SHARES = (1.0, 1.0, 0.2, 0.4, 1.0)  # of all strokes, at most so many in a level

Look = Callable[[Tensor, Tensor], Told]  # what `StrokePredictor.forward` does


class Level(NamedTuple):
    """A lattice of cells, of which some get a stroke."""

    rows: int
    columns: int
    keep: int  # strokes that are laid
    side: float  # mean side of a cell, in mean distances between strokes


@dataclass(frozen=True)
class Laid:
    """What is on the canvas of one picture after a level."""

    strokes: Strokes  # the lowest first, in pixels
    canvas: Tensor  # (3, h, w), no larger than what the next level sees
    cells: Tensor  # (K,) numbers of the cells that got a stroke in this level, row by row
    errors: Tensor  # (K,) mean squared errors that those cells had before
    worth: Tensor  # (K,) log-odds of the share of that which the strokes remove, as the network expects
    deviations: Tensor  # (K, 11) logarithms of those of the numbers of the strokes


def levels_of(size: tuple[int, int], n: int) -> list[Level]:
    """Plan the levels for exactly ``n`` strokes on a canvas of ``size`` (H, W)."""
    pitch, levels, rest = math.sqrt(size[0] * size[1] / n), [], n
    for side, share in zip(SIZES, SHARES, strict=True):
        rows, columns = (max(1, round(length / (side * pitch))) for length in size)
        keep = min(rest, rows * columns, max(1, round(share * n)))
        levels += [Level(rows, columns, keep, side)] if keep else []
        rest -= keep
    while rest:  # cells of a strip that is narrower than they are may be fewer than strokes
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
    """Lay the strokes of targets (3, H, W) by the same levels; for each level what is then on each canvas.

    ``focus`` (H, W) weighs the pixels where it is decided which cells get a stroke.

    Gradients of a level's canvas flow into the strokes of that level and those before it, but through no canvas that
    the network sees.
    """
    backgrounds = [target.mean((1, 2)) for target in targets]
    done: list[Laid] = []
    for number, level in enumerate(levels):
        shape = (CELL * level.rows, CELL * level.columns)
        seen = torch.stack([resized(target, shape) for target in targets])
        if done:
            canvas = torch.stack([resized(laid.canvas.detach(), shape) for laid in done])
        else:
            canvas = torch.stack(backgrounds)[:, :, None, None].expand_as(seen)
        numbers, deviations, worth = network(seen, canvas)
        if temperature:
            noise = torch.randn(numbers.shape, generator=generator, dtype=numbers.dtype)
            numbers = numbers + temperature * deviations.exp() * noise
        means = avg_pool2d(seen, CELL).permute(0, 2, 3, 1)
        errors = errors_of(seen, canvas)
        gains = errors * worth.detach().sigmoid()
        if focus is not None:
            gains = gains * adaptive_avg_pool2d(focus[None], (level.rows, level.columns))
        following = levels[number + 1] if number + 1 < len(levels) else None
        before, done = done, []
        for k, target in enumerate(targets):
            cells = gains[k].flatten().topk(level.keep).indices.sort().values
            said, mean = numbers[k].flatten(0, 1)[cells], means[k].flatten(0, 1)[cells]
            new = level_strokes(form, level, said, mean, cells, target)
            strokes = Strokes.join(before[k].strokes, new) if number else new
            zoom, small = 1.0, (target.shape[1], target.shape[2])
            if following is not None:
                zoom = min(1.0, CELL * math.sqrt(following.rows * following.columns / target[0].numel()))
                small = (max(1, round(small[0] * zoom)), max(1, round(small[1] * zoom)))
            drawn = draw(form, strokes.moved(zoom=zoom) if zoom < 1 else strokes, small, backgrounds[k])
            each = (errors[k].flatten(), worth[k].flatten(), deviations[k].flatten(0, 1))
            done.append(Laid(strokes, drawn, cells, *(values[cells] for values in each)))
        yield done


def errors_of(seen: Tensor, canvas: Tensor) -> Tensor:
    """Compute the mean squared errors of cells (B, H, W) from pictures (B, 3, `CELL` H, `CELL` W)."""
    return avg_pool2d((seen - canvas).square().sum(1), CELL)


def level_strokes(form: Form, level: Level, numbers: Tensor, mean: Tensor, cells: Tensor, target: Tensor) -> Strokes:
    """Make the strokes of some cells of a level, large ones below small ones."""
    height, width = target.shape[1] / level.rows, target.shape[2] / level.columns
    row, column = cells // level.columns, cells % level.columns
    middle = torch.stack([(column + 0.5) * width, (row + 0.5) * height], 1).to(target)
    strokes = strokes_of(form, numbers, mean, middle, math.sqrt(height * width))
    return strokes[areas_of(strokes.map(Tensor.detach)).argsort(descending=True)]


def resized(picture: Tensor, size: tuple[int, int]) -> Tensor:
    """Resize a picture (3, H, W)."""
    if tuple(picture.shape[1:]) == size:
        return picture
    return interpolate(picture[None], size, mode="bilinear", antialias=True, align_corners=False)[0]
