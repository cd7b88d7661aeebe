"""Place strokes at random."""

from dataclasses import dataclass
from typing import Annotated

import numpy as np
import torch
from torch import Tensor

from brushexp.bounds import between
from brushexp.plugins.init._cells import CellInitializer, nearest
from brushexp.registry import register


@register("init", "random")
@dataclass(kw_only=True)
class Random(CellInitializer):
    """Places strokes at evenly distributed random points; each stroke fills the Voronoi cell of its point."""

    jitter: Annotated[float, between(0, 10)] = 0.0

    def cells(self, target: Tensor, n: int, generator: torch.Generator, focus: Tensor | None) -> np.ndarray:
        _, height, width = target.shape
        pixel = torch.randperm(height * width, generator=generator)[:n].numpy()
        y, x = np.divmod(np.arange(height * width), width)
        points = np.stack([x, y], 1)
        return nearest(points[pixel], points).reshape(height, width)
