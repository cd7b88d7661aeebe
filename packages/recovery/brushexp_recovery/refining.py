"""Strokes are moved by gradient descent until, drawn over each other, they show the regions that were found."""

from collections.abc import Callable
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from brushexp import create
from brushexp.strokes.bezier import strokes_along
from brushexp_recovery.curves import Fitted
from brushexp_recovery.raster.threads import map_on_threads
from brushexp_recovery.raster.tiles import Box, split_into_tiles

Array = NDArray[Any]
Progress = Callable[[float, str], None]

STEPS = 60
SIDE = 1200  # pixels of a tile
SOFT = 1.5  # pixels over which an edge rises
RATE = 0.04  # widths of a stroke, of a step
FINAL = 0.1  # of the rate, at the end
HELD = 0.02  # how strongly a stroke is held to where it began: what is hidden has no other reason to stay
EMPTY = 0.35  # weight of a pixel without a region: there may be a stroke that was not found
SMALLER = 0.5  # power of its area by which a pixel of a large region counts less
BEYOND = 4.0  # widths that a point may move at most


def refine(fitted: Fitted, labels: Array, order: Array, *, show: Progress, steps: int = STEPS) -> Fitted:
    """Fit strokes, which lie bottom to top by ``order`` (N,), to regions (H, W), numbered as they are.

    A large picture is fitted tile by tile; a stroke belongs to the tile in whose core its middle lies.
    """
    curve, width = fitted.curve.copy(), fitted.width.copy()
    x, y = fitted.curve.mean(1).T
    boxes = list(split_into_tiles(labels.shape[0], labels.shape[1], 1.0, SIDE, SIDE // 8))

    def fit(at: tuple[Box, Box]) -> None:
        box, core = at
        near = order[_inside(x[order], y[order], box, labels.shape)]
        own = _inside(x[near], y[near], core, labels.shape)
        if not own.any():
            return
        place = np.full(len(order) + 1, -2)
        place[near], place[-1] = np.arange(len(near)), -1
        part = place[labels[box[0] : box[1], box[2] : box[3]]]
        corner = np.array([box[2], box[0]])
        moved, wider = _refined(fitted.curve[near] - corner, fitted.width[near], part, steps)
        curve[near[own]], width[near[own]] = moved[own] + corner, wider[own]

    for number, _ in enumerate(map_on_threads(fit, boxes), start=1):
        show(number / len(boxes), f"fitting {len(order)} curves")
    return Fitted(curve, width, fitted.color)


def _inside(x: Array, y: Array, box: Box, size: tuple[int, ...]) -> Array:
    """Tell which places (N,) are in a box; those off the picture count as at its border."""
    x, y = x.clip(0, size[1] - 1e-3), y.clip(0, size[0] - 1e-3)
    return (y >= box[0]) & (y < box[1]) & (x >= box[2]) & (x < box[3])


def _refined(curve: Array, thickness: Array, labels: Array, steps: int) -> tuple[Array, Array]:
    """Fit curves (N, 3, 2) and thicknesses (N,), bottom to top, to their regions; -1 is empty, and -2 counts nothing.

    The loss is the squared difference, over pixels and strokes, of what is seen of a stroke and its region. It is
    estimated, without bias, by drawing the strokes in codes, colours of 0 or 1 that are drawn anew at every step.
    """
    generator, count = torch.Generator().manual_seed(0), len(curve)
    begin, width = (torch.as_tensor(value, dtype=torch.float32) for value in (curve, thickness))
    moved, wider = torch.zeros_like(begin, requires_grad=True), torch.zeros_like(width, requires_grad=True)
    regions = torch.as_tensor(labels.astype(np.int64)) + 2
    weight, top_first = _weights(regions, count), torch.arange(count).flip(0)
    renderer, blend = create("renderer", "analytic", soft=SOFT), create("blend", "tiled")
    optimizer = torch.optim.Adam([moved, wider], RATE, betas=(0.8, 0.98))
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, steps, RATE * FINAL)
    for _ in range(steps):
        codes = torch.randint(2, (count + 2, 3), generator=generator).float()
        codes[:2] = 0.5  # without a stroke
        strokes = strokes_along(begin + width[:, None, None] * moved, width * wider.exp(), codes[2:], 1.0)
        image = blend(renderer(strokes), top_first, tuple(labels.shape), codes[0]).image
        error = ((image - codes[regions].movedim(-1, 0)).square().sum(0) * weight).sum() / weight.sum()
        optimizer.zero_grad()
        (4 * error + HELD * (moved.square().mean() + wider.square().mean())).backward()
        optimizer.step()
        schedule.step()
        with torch.no_grad():
            moved.clamp_(-BEYOND, BEYOND)
            wider.clamp_(-1, 1)
    with torch.no_grad():
        curves, thick = begin + width[:, None, None] * moved, width * wider.exp()
    return curves.double().numpy(), thick.double().numpy()


def _weights(regions: Tensor, count: int) -> Tensor:
    """Say how much each pixel (H, W) counts; region 0 counts nothing, 1 is empty, and stroke k is k + 2."""
    area = torch.bincount(regions.flatten(), minlength=count + 2).clamp_min(1).float()
    weight = (area[2:].mean() / area) ** SMALLER
    weight[:2] = torch.tensor([0.0, EMPTY])
    return weight[regions]
