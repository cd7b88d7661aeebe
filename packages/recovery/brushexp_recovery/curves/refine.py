"""Refine curves by gradient descent until the rendered strokes reproduce the regions."""

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from brushexp.contracts.runs import create
from brushexp.contracts.strokes import strokes_along
from brushexp_recovery.curves.fit import StrokeCurves
from brushexp_recovery.raster.boxes import Box
from brushexp_recovery.raster.threads import Progress, map_on_threads
from brushexp_recovery.raster.tiles import Tile, split_into_tiles

Array = NDArray[Any]

REFINEMENT_STEPS = 60
TILE_SIDE = 1200  # side of a tile in pixels
EDGE_WIDTH = 1.5  # pixels over which the edge of a stroke rises
RATE = 0.04  # learning rate, in widths of a stroke
FINAL_RATE = 0.1  # final share of the rate
ANCHOR = 0.02  # regularisation of a stroke towards its start, which keeps hidden parts in place
EMPTY_WEIGHT = 0.35  # weight of a pixel without a region, which may belong to an undetected stroke
AREA_POWER = 0.5  # power of the area by which the weight of a region's pixels is divided
FARTHEST_MOVE = 4.0  # maximum displacement of a point in widths
UNKNOWN, EMPTY = -2, -1  # labels of pixels of strokes in other tiles, and of pixels without a stroke


def refine_curves(
    strokes: StrokeCurves, labels: Array, order: Array, *, show: Progress, steps: int = REFINEMENT_STEPS
) -> StrokeCurves:
    """Refine strokes to fit their regions (H, W); ``order`` (N,) lists the strokes bottom to top.

    Stroke k is fitted to the region with the label k. A large picture is fitted tile by tile; a stroke belongs to the
    tile whose core contains the stroke's middle.
    """
    curve, width = strokes.curve.copy(), strokes.width.copy()
    middle = strokes.curve.mean(1)
    tiles = list(split_into_tiles(labels.shape[0], labels.shape[1], 1.0, TILE_SIDE, TILE_SIDE // 8))

    def fit(tile: Tile) -> None:
        near = order[_lies_in(middle[order], tile.box, labels.shape)]
        own = _lies_in(middle[near], tile.core, labels.shape)
        if not own.any():
            return
        number = np.full(len(order) + 1, UNKNOWN)  # the last entry is for pixels without a stroke
        number[near] = np.arange(len(near))
        number[-1] = EMPTY
        corner = np.array([tile.box.left, tile.box.top])
        part = number[labels[tile.box.slices]]
        new_curve, new_width = _fit_to_regions(strokes.curve[near] - corner, strokes.width[near], part, steps)
        curve[near[own]] = new_curve[own] + corner
        width[near[own]] = new_width[own]

    for done, _ in enumerate(map_on_threads(fit, tiles), start=1):
        show(done / len(tiles), f"fitting {len(order)} curves")
    return StrokeCurves(curve, width, strokes.color)


def _lies_in(places: Array, box: Box, size: tuple[int, ...]) -> Array:
    """Mark the positions (N, 2) that are inside a box; positions off the picture are first clamped to its border."""
    x, y = places.T
    x, y = x.clip(0, size[1] - 1e-3), y.clip(0, size[0] - 1e-3)
    return (y >= box.top) & (y < box.bottom) & (x >= box.left) & (x < box.right)


def _fit_to_regions(curve: Array, width: Array, labels: Array, steps: int) -> tuple[Array, Array]:
    """Fit curves (N, 3, 2) and widths (N,), bottom to top, to labelled regions (H, W).

    Pixels labelled `EMPTY` or `UNKNOWN` belong to no region. The loss is the squared difference between a stroke's
    visible part and its region, over pixels and strokes. To estimate it without bias, strokes are rendered in random
    binary colours that are resampled at every step.
    """
    generator, count = torch.Generator().manual_seed(0), len(curve)
    start_curve, start_width = (torch.as_tensor(value, dtype=torch.float32) for value in (curve, width))
    move = torch.zeros_like(start_curve, requires_grad=True)  # in widths
    log_gain = torch.zeros_like(start_width, requires_grad=True)  # logarithm of the width's factor
    regions = torch.as_tensor(labels.astype(np.int64)) - UNKNOWN
    weight, top_first = _pixel_weights(regions, count), torch.arange(count).flip(0)
    renderer, blend = create("renderer", "analytic", soft=EDGE_WIDTH), create("blend", "tiled")
    optimizer = torch.optim.Adam([move, log_gain], RATE, betas=(0.8, 0.98))
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, steps, RATE * FINAL_RATE)
    for _ in range(steps):
        codes = torch.randint(2, (count + 2, 3), generator=generator).float()
        codes[:2] = 0.5  # pixels without a stroke
        curves, widths = _move(start_curve, start_width, move, log_gain)
        image = blend(renderer(strokes_along(curves, widths, codes[2:], 1.0)), top_first, labels.shape, codes[0]).image
        error = ((image - codes[regions].movedim(-1, 0)).square().sum(0) * weight).sum() / weight.sum()
        optimizer.zero_grad()
        (4 * error + ANCHOR * (move.square().mean() + log_gain.square().mean())).backward()
        optimizer.step()
        schedule.step()
        with torch.no_grad():
            move.clamp_(-FARTHEST_MOVE, FARTHEST_MOVE)
            log_gain.clamp_(-1, 1)
    with torch.no_grad():
        curves, widths = _move(start_curve, start_width, move, log_gain)
    return curves.double().numpy(), widths.double().numpy()


def _move(curve: Tensor, width: Tensor, move: Tensor, log_gain: Tensor) -> tuple[Tensor, Tensor]:
    """Move control points by multiples of the stroke's width, and multiply widths by ``exp(log_gain)``."""
    return curve + width[:, None, None] * move, width * log_gain.exp()


def _pixel_weights(regions: Tensor, count: int) -> Tensor:
    """Weight each pixel (H, W) by its region: 0 is unknown and gets no weight, 1 is empty, and k + 2 is stroke k."""
    area = torch.bincount(regions.flatten(), minlength=count + 2).clamp_min(1).float()
    weight = (area[2:].mean() / area) ** AREA_POWER
    weight[:2] = torch.tensor([0.0, EMPTY_WEIGHT])
    return weight[regions]
