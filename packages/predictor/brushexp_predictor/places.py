"""Which stroke is seen at a place."""

import torch
from torch import Tensor

from brushexp.strokes.bezier import closest_parameter, curve_of, half_width_of, point_at
from brushexp.strokes.catalogue import Strokes

SEEN = 0.5  # opacity from which on a stroke hides what is below
AT_ONCE = 512  # places


@torch.no_grad()
def topmost(strokes: Strokes, places: Tensor) -> Tensor:
    """Find the uppermost stroke (P,) at places (P, 2: x, y in pixels), -1 where there is none.

    Strokes are in their order, the lowest first; each is a line of its width with round ends, and fainter ones than
    `SEEN` are looked through.
    """
    curve, half = curve_of(strokes), half_width_of(strokes)
    low, high = curve.amin(1) - half[:, None], curve.amax(1) + half[:, None]
    found = torch.full((len(places),), -1)
    for own, part in zip(found.split(AT_ONCE), places.to(curve).split(AT_ONCE), strict=True):
        near = ((part[:, None] >= low) & (part[:, None] <= high)).all(2) & (strokes.opacity >= SEEN)
        place, stroke = near.nonzero(as_tuple=True)
        parameter = closest_parameter(curve[stroke], part[place])
        on = (point_at(curve[stroke], parameter) - part[place]).norm(dim=1) <= half[stroke]
        own.scatter_reduce_(0, place[on], stroke[on], "amax")
    return found


def lattice(size: tuple[int, int], step: float) -> Tensor:
    """Make places (rows, columns, 2: x, y) some ``step`` pixels apart on a canvas (H, W), as middles of equal cells."""
    rows, columns = (max(1, round(length / step)) for length in size)
    y, x = (torch.arange(rows) + 0.5) * size[0] / rows, (torch.arange(columns) + 0.5) * size[1] / columns
    return torch.stack(torch.meshgrid(x, y, indexing="xy"), 2)
