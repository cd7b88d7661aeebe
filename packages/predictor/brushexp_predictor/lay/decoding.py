"""Decode the network's output into strokes in pixels, and draw them."""

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from brushexp.contracts.families import Compositor
from brushexp.contracts.members import Analytic, Rgb, Textured, Tiled
from brushexp.contracts.strokes import Strokes, strokes_along

LARGEST_SHIFT = 1.5  # maximum distance of a stroke's middle from its cell's centre, in cells
BEND = 2.0  # maximum distance of the control point from the chord, in half lengths
TONE = 0.5  # maximum difference from the cell's mean colour
BLEND = Compositor(Tiled(), Rgb())
PLAIN, BRUSHED = Analytic(), Textured().requires_grad_(False)
FIRST_OPACITY = 3.0  # log-odds for an output of 0


@dataclass(frozen=True)
class Form:
    """Lengths, widths and windows of a network's strokes, relative to the side of a cell."""

    half_length: float  # half length for an output of 0
    width: float
    spread: float  # logarithm of the largest factor of half length and width
    window: float  # scales the optimiser's steps, which are small for strokes that are nearly in place
    brushed: bool  # whether strokes are opaque with bristle marks


FORMS = {"plain": Form(0.7, 1.2, 1.6, 2.2, False), "brushed": Form(1.5, 1.0, 0.7, 9.0, True)}


def strokes_of(form: Form, numbers: Tensor, mean: Tensor, middle: Tensor, cell: float) -> Strokes:
    """Decode the network's output for N cells into strokes.

    Args:
        form: lengths, widths and windows of the network's strokes.
        numbers: the network's output (N, 11).
        mean: mean colours (N, 3) of the target within the cells.
        middle: centres (N, 2) of the cells, as x and y in pixels.
        cell: side of a cell, in pixels.
    """
    place, turn, shape = numbers[:, 0:2], numbers[:, 2:4], torch.tanh(numbers[:, 4:7])
    angle = 0.5 * torch.atan2(turn[:, 1], turn[:, 0] + 1e-3)
    along = torch.stack([angle.cos(), angle.sin()], 1)
    across = torch.stack([-along[:, 1], along[:, 0]], 1)
    half = form.half_length * cell * torch.exp(form.spread * shape[:, 0:1])
    control = BEND * shape[:, 1:2] * half * across
    opacity = torch.sigmoid(numbers[:, 10] + FIRST_OPACITY)
    return strokes_along(
        torch.stack([-half * along, control, half * along], 1),
        form.width * cell * torch.exp(form.spread * shape[:, 2]),
        mean + TONE * torch.tanh(numbers[:, 7:10]),
        torch.ones_like(opacity) if form.brushed else opacity,
        window=form.window * cell,
        position=middle + LARGEST_SHIFT * cell * torch.tanh(place),
    )


def areas_of(strokes: Strokes) -> Tensor:
    """Estimate the areas (N,) of strokes in square pixels."""
    length = (strokes.end - strokes.start).norm(dim=1) * strokes.scale / 2
    width = strokes.width * strokes.scale
    return width * (length + width * math.pi / 4)


def draw(form: Form, strokes: Strokes, size: tuple[int, int], background: Tensor) -> Tensor:
    """Draw strokes, bottom to top, as a picture (3, H, W), with the renderer used to train networks of this form."""
    renderer = BRUSHED if form.brushed else PLAIN
    front_to_back = torch.arange(len(strokes) - 1, -1, -1, device=strokes.position.device)
    return BLEND(renderer(strokes), front_to_back, size, background).image
