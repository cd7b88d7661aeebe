"""Strokes at random places."""

from typing import Annotated

import numpy as np
import torch
from torch import Tensor

from brushexp.bounds import above, between
from brushexp.plugins.init._cells import Look, Orient, nearest, strokes_of_cells
from brushexp.plugins.init.base import Initializer
from brushexp.registry import register
from brushexp.strokes.catalogue import Strokes


@register("init", "random")
class Random(Initializer):
    """Random places, evenly distributed: each stroke in its Voronoi cell.

    Args:
        orient: structure (along the picture's edges) or random (the thesis's).
        length: of a stroke, in sides of its cell (structure only).
        width: of a stroke, in sides of its cell (structure only).
        opacity: 0 to 1.
    """

    def __init__(
        self,
        *,
        orient: Orient = Orient.structure,
        length: Annotated[float, above(0, 10)] = 1.4,
        width: Annotated[float, above(0, 10)] = 1.0,
        opacity: Annotated[float, between(0, 1)] = 0.95,
    ) -> None:
        self.look = Look(orient, length, width, opacity, jitter=0.0)

    def __call__(
        self, target: Tensor, n_strokes: int, generator: torch.Generator, focus: Tensor | None = None
    ) -> Strokes:
        _, height, width = target.shape
        pixel = torch.randperm(height * width, generator=generator)[:n_strokes].numpy()
        y, x = np.divmod(np.arange(height * width), width)
        points = np.stack([x, y], 1)
        labels = nearest(points[pixel], points).reshape(height, width)
        return strokes_of_cells(target, labels, n_strokes, self.look, generator)
