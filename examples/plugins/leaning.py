"""Change plugin in a single file: ``+change=[leaning]``."""

import math
from dataclasses import replace
from typing import Annotated

import torch
from torch import Tensor

from brushexp.contracts import between, register
from brushexp.contracts.families import Change, PaintingState
from brushexp.contracts.strokes import Strokes


@register("change", "leaning")
class Leaning(Change):
    """All strokes are slanted in the same direction, like hand-drawn hatching.

    Args:
        angle: direction from the first point of a stroke to the last, in degrees; 0 is horizontal, 90 vertical.
    """

    def __init__(self, *, angle: Annotated[float, between(-90, 90)] = 45.0) -> None:
        self.angle = angle

    def begin(self, strokes: Strokes, state: PaintingState) -> Strokes:
        return self.lean(strokes)

    def limit(self, strokes: Strokes, before: Strokes | None, rows: Tensor | None, state: PaintingState) -> Strokes:
        return self.lean(strokes)  # whatever a step has made of them

    def lean(self, strokes: Strokes) -> Strokes:
        """Rotate each stroke about its position to the required angle; y points downwards."""
        x, y = (strokes.end - strokes.start).T
        turn = -math.radians(self.angle) - torch.atan2(y, x)
        cosine, sine = turn.cos(), turn.sin()
        rotation = torch.stack([torch.stack([cosine, sine], -1), torch.stack([-sine, cosine], -1)], -2)  # (N, 2, 2)
        points = {name: getattr(strokes, name) for name in ("start", "control", "end")}
        return replace(strokes, **{name: (one[:, None] @ rotation)[:, 0] for name, one in points.items()})
