"""Initialiser plugin in a single file: ``init=raster``."""

import math
from typing import Annotated

import torch
from torch import Tensor

from brushexp.contracts import between, register
from brushexp.contracts.families import Initializer
from brushexp.contracts.strokes import Strokes, roomy_window, strokes_along


@register("init", "raster")
class Raster(Initializer):
    """Places horizontal strokes in rows, like the lines of an old television.

    Args:
        overlap: overlap of neighbouring strokes in a row, as a fraction of their spacing.
    """

    def __init__(self, *, overlap: Annotated[float, between(0, 10)] = 0.5) -> None:
        self.overlap = overlap

    def __call__(self, target: Tensor, n: int, generator: torch.Generator, focus: Tensor | None = None) -> Strokes:
        _, height, width = target.shape
        rows = max(1, round(math.sqrt(n * height / width)))
        columns = math.ceil(n / rows)
        number = torch.arange(n)
        x = (number % columns + 0.5) * width / columns  # pixels
        y = (number // columns + 0.5) * height / rows
        half = 0.5 * (1 + self.overlap) * width / columns
        curve = torch.stack([torch.stack([x + step * half, y], -1) for step in (-1, 0, 1)], 1)  # (n, 3, 2)
        color = target[:, y.long(), x.long()].T
        return strokes_along(curve, height / rows, color, 0.95, window=roomy_window(4 * half))
