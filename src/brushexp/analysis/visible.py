"""How much of each stroke can be seen."""

from __future__ import annotations

import math
from dataclasses import replace

import torch
from torch import Tensor

from brushexp.strokes.catalogue import Strokes

LARGEST = 2**20  # pixels: a larger canvas is looked at reduced to so many
FILM = 1e-4  # share of their opacity with which strokes are laid when none is to hide another
NOTHING = 1e-6  # pixels of paint on the canvas: less is none


def visible_share(strokes: Strokes, depth: Tensor, size: tuple[int, int]) -> Tensor:
    """Share (N,) of the paint of each stroke on the canvas that later strokes let through, in [0, 1].

    That is sum(alpha T) / sum(alpha) over the pixels of the canvas, T being the share of light that the strokes above
    let through, with every stroke as ``renderer=analytic`` draws it, whatever it was painted with, so that paintings
    of different renderers compare. The picture is linear in the colour of each stroke, so both sums are the slope of
    its brightness in that colour, for all strokes at once; the second with strokes that are almost transparent.

    Args:
        strokes: N strokes.
        depth: (N,) ranks, 0 is the bottom stroke.
        size: height and width of the canvas, pixels.
    """
    if not len(strokes):
        return torch.zeros(0)
    zoom = min(1.0, math.sqrt(LARGEST / (size[0] * size[1])))
    small = (max(1, round(size[0] * zoom)), max(1, round(size[1] * zoom)))
    laid = strokes.map(Tensor.float).moved(zoom=zoom)
    above = depth.argsort(descending=True)
    seen = _paint_of(laid, above, small)
    whole = _paint_of(replace(laid, opacity=FILM * laid.opacity), above, small) / FILM
    return torch.where(whole > NOTHING, seen / whole.clamp_min(NOTHING), 0.0).clamp(0, 1)


def _paint_of(strokes: Strokes, above: Tensor, size: tuple[int, int]) -> Tensor:
    """Sum (N,) over the canvas of what each stroke adds to the picture per unit of its colour."""
    from brushexp.plugins.blend.tiled import Tiled  # noqa: PLC0415  (slow to import)
    from brushexp.plugins.renderer.analytic import Analytic  # noqa: PLC0415

    color = torch.zeros_like(strokes.color).requires_grad_()
    with torch.enable_grad():
        layers = Analytic()(replace(strokes, color=color))
        picture = Tiled()(layers, above, size, torch.zeros(3)).image
        (slope,) = torch.autograd.grad(picture[0].sum(), color, allow_unused=True, materialize_grads=True)
    return slope[:, 0]
