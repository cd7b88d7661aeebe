"""What a table has, mixtures and brushes and a load of paint, and strokes as they can be painted with that."""

from dataclasses import dataclass, replace

import torch
from torch import Tensor

from brushexp.contracts.families import Order
from brushexp.contracts.strokes import Strokes, curve_of, half_width_of, length_of
from brushexp_changes.tubes.mixtures import Mixtures, differences

SHORTEST = 1e-3  # pixels: no width or length is smaller where one is divided by it
ROUNDING = 1e-3  # of the share of a rank


@dataclass(frozen=True, eq=False)
class Table:
    """M mixtures, B brushes, and how far a brush paints with one load."""

    mixtures: Mixtures
    brushes: Tensor  # (B,) widths in pixels, from large to small
    load: float  # length that a brush paints until it is dipped again, in widths of the brush

    def mixture_of(self, color: Tensor) -> Tensor:
        """Find the mixture (N,) that is nearest to each colour (N, 3) to the eye (CIEDE2000).

        Most colours are those of mixtures already, for which less is computed.
        """
        mixtures = self.mixtures.color.to(color)
        away, number = torch.cdist(color, mixtures, compute_mode="donot_use_mm_for_euclid_dist").min(1)
        others = (away > 0).nonzero()[:, 0]
        if len(others):
            seen = color[others].clamp(0, 1).double().cpu().numpy()
            nearest = differences(seen, self.mixtures.color.double().numpy()).argmin(1)
            number[others] = torch.from_numpy(nearest).to(number)
        return number

    def brush_of(self, strokes: Strokes) -> Tensor:
        """Find the brush (N,) whose width has the ratio nearest to 1 to that of each stroke."""
        width = 2 * half_width_of(strokes).clamp_min(SHORTEST)
        return (width.log()[:, None] - self.brushes.to(width).log()).abs().argmin(1)

    def deal(self, strokes: Strokes) -> Strokes:
        """Give strokes brushes by the rank of their widths, so many that each brush paints about as large an area."""
        share = (1 / self.brushes.double().square()).cumsum(0)
        place = torch.arange(1, len(strokes) + 1) / max(1, len(strokes))
        brush = torch.searchsorted(share / share[-1], place.double() * (1 - ROUNDING))
        rank = strokes.width.mul(strokes.scale).argsort(descending=True, stable=True).argsort()
        return self.with_brushes(replace(strokes, width=self.brushes[brush].to(strokes.width)[rank] / strokes.scale))

    def with_brushes(self, strokes: Strokes) -> Strokes:
        """Make strokes opaque, as wide as their brushes all along, and not longer than a load, about their middles."""
        width = self.brushes.to(strokes.scale)[self.brush_of(strokes)]
        share = (self.load * width / length_of(curve_of(strokes)).clamp_min(SHORTEST)).clamp_max(1)[:, None]
        middle = (strokes.start + 2 * strokes.control + strokes.end) / 4
        points = {name: getattr(strokes, name) for name in ("start", "control", "end")}
        points = {name: torch.where(share < 1, middle + share * (p - middle), p) for name, p in points.items()}
        points |= {name: torch.zeros_like(width) for name in ("softness", "widening")}
        return replace(strokes, width=width / strokes.scale, opacity=torch.ones_like(width), **points)

    def with_mixtures(self, strokes: Strokes) -> Strokes:
        """Give each stroke the colour of its nearest mixture, all along it; one that has such a colour keeps it."""
        color = self.mixtures.color.to(strokes.color)[self.mixture_of(strokes.color)]
        return replace(strokes, color=color, drift=torch.zeros_like(color))

    def stage_of(self, strokes: Strokes) -> Tensor:
        """Number the stages (N,) in which strokes are painted: large brushes first, with each from dark to light."""
        return self.brush_of(strokes) * len(self.mixtures) + self.mixture_of(strokes.color)


class StageOrder(Order):
    """What is painted in a later stage lies on top."""

    every, until = 1, 1.0

    def __init__(self, table: Table) -> None:
        self.table = table

    def depth(self, strokes: Strokes, accuracy: Tensor | None) -> Tensor:
        return self.table.stage_of(strokes).to(strokes.opacity)
