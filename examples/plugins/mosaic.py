"""Painter plugin in a single file: ``painter=mosaic``."""

from collections.abc import Iterator

import torch
from torch.nn import functional

from brushexp.contracts import register
from brushexp.contracts.families import Painter, PaintRequest, PaintState
from brushexp.contracts.strokes import strokes_along


@register("painter", "mosaic")
class Mosaic(Painter):
    """Round dabs in rows, each in the mean colour of its cell of the picture."""

    kind = "mean colours"

    def __call__(self, request: PaintRequest) -> Iterator[PaintState]:
        height, width = request.size
        rows = max(1, min(height, round((request.n * height / width) ** 0.5)))
        columns = max(1, min(width, request.n // rows))
        color = functional.adaptive_avg_pool2d(request.target[None], (rows, columns))[0].flatten(1).T
        y, x = torch.meshgrid(torch.arange(rows) + 0.5, torch.arange(columns) + 0.5, indexing="ij")
        place = torch.stack([x.flatten() * width / columns, y.flatten() * height / rows], -1)
        strokes = strokes_along(place[:, None].expand(-1, 3, -1), request.pitch, color, 1.0)
        for row in range(1, rows + 1):
            yield PaintState(strokes[torch.arange(row * columns)], row, rows)
