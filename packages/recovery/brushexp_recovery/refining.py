"""Strokes are moved by gradient descent until, drawn over each other, they show the regions that were found."""

from collections.abc import Callable
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from brushexp.registry import build_named
from brushexp.strokes.bezier import strokes_along
from brushexp_recovery.curves import Fitted

Array = NDArray[Any]
Progress = Callable[[float, str], None]

STEPS = 60
RATE = 0.04  # widths of a stroke, of a step
FINAL = 0.1  # of the rate, at the end
HELD = 0.02  # how strongly a stroke is held to where it began: what is hidden has no other reason to stay
EMPTY = 0.35  # weight of a pixel without a region: there may be a stroke that was not found
SMALLER = 0.5  # power of its area by which a pixel of a large region counts less
BEYOND = 4.0  # widths that a point may move at most


def refine(fitted: Fitted, labels: Array, order: Array, *, show: Progress, steps: int = STEPS) -> Fitted:
    """Fit strokes, which lie bottom to top by ``order`` (N,), to regions (H, W), numbered as they are.

    The loss is the squared difference, over pixels and strokes, of what is seen of a stroke and its region. It is
    estimated, without bias, by drawing the strokes in codes, colours of -1 or 1 that are drawn anew at every step.
    """
    count = len(order)
    if count == 0:
        return fitted
    generator = torch.Generator().manual_seed(0)
    begin, width = (torch.as_tensor(value, dtype=torch.float32) for value in (fitted.curve, fitted.width))
    moved, wider = torch.zeros_like(begin, requires_grad=True), torch.zeros_like(width, requires_grad=True)
    regions = torch.as_tensor(labels.astype(np.int64)) + 1
    weight = _weights(regions, count)
    top_first = torch.as_tensor(order[::-1].copy())
    renderer, blend = build_named("renderer", "analytic", {"soft": 1.5}), build_named("blend", "tiled", {})
    optimizer = torch.optim.Adam([moved, wider], RATE, betas=(0.8, 0.98))
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, steps, RATE * FINAL)
    for step in range(steps):
        show(step / steps, f"fitting {count} curves")
        codes = torch.randint(2, (count + 1, 3), generator=generator).float()
        codes[0] = 0.5  # the ground
        strokes = strokes_along(begin + width[:, None, None] * moved, width * wider.exp(), codes[1:], 1.0)
        image = blend(renderer(strokes), top_first, tuple(labels.shape), codes[0]).image
        error = ((image - codes[regions].movedim(-1, 0)).square().sum(0) * weight).sum() / weight.sum()
        held = HELD * (moved.square().mean() + wider.square().mean())
        optimizer.zero_grad()
        (error * 4 + held).backward()  # type: ignore[no-untyped-call]
        optimizer.step()
        schedule.step()
        with torch.no_grad():
            moved.clamp_(-BEYOND, BEYOND)
            wider.clamp_(-1, 1)
    with torch.no_grad():
        curve, thick = begin + width[:, None, None] * moved, width * wider.exp()
    return Fitted(curve.numpy().astype(float), thick.numpy().astype(float), fitted.color)


def _weights(regions: Tensor, count: int) -> Tensor:
    """Say how much each pixel (H, W) counts; region 0 is the ground."""
    area = torch.bincount(regions.flatten(), minlength=count + 1).clamp_min(1).float()
    weight = (area[1:].mean() / area) ** SMALLER
    weight[0] = EMPTY
    return weight[regions]
