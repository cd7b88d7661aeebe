"""Adapt strokes to a table: its mixtures, its brushes, and the load of paint that a brush holds."""

from dataclasses import dataclass, replace

import torch
from torch import Tensor

from brushexp.contracts.families import Order
from brushexp.contracts.strokes import Strokes, curve_of, half_width_of, length_of
from brushexp_changes.tubes.mixtures import Mixtures, differences

SHORTEST = 1e-3  # lower bound in pixels of widths and lengths used as divisors
ROUNDING = 1e-3  # relative tolerance of a rank's share


@dataclass(frozen=True, eq=False)
class Table:
    """A table of M mixtures and B brushes, and the length that a brush paints with one load."""

    mixtures: Mixtures
    brushes: Tensor  # (B,) widths in pixels, from large to small
    load: float  # length that a brush paints between dips, in brush widths

    def mixture_of(self, color: Tensor) -> Tensor:
        """Find the perceptually nearest mixture (N,) for each colour (N, 3), by CIEDE2000.

        Most colours already match a mixture exactly, and CIEDE2000 is computed only for the others.
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
        """Find the brush (N,) whose width is closest to the width of each stroke, measured as a ratio."""
        width = 2 * half_width_of(strokes).clamp_min(SHORTEST)
        return (width.log()[:, None] - self.brushes.to(width).log()).abs().argmin(1)

    def deal(self, strokes: Strokes) -> Strokes:
        """Assign brushes to strokes by rank of stroke width, so that each brush paints about the same area."""
        share = (1 / self.brushes.double().square()).cumsum(0)
        place = torch.arange(1, len(strokes) + 1) / max(1, len(strokes))
        brush = torch.searchsorted(share / share[-1], place.double() * (1 - ROUNDING))
        rank = strokes.width.mul(strokes.scale).argsort(descending=True, stable=True).argsort()
        return self.with_brushes(replace(strokes, width=self.brushes[brush].to(strokes.width)[rank] / strokes.scale))

    def with_brushes(self, strokes: Strokes) -> Strokes:
        """Make strokes opaque, as wide as their brushes throughout, and at most one load long; keep their centres."""
        width = self.brushes.to(strokes.scale)[self.brush_of(strokes)]
        share = (self.load * width / length_of(curve_of(strokes)).clamp_min(SHORTEST)).clamp_max(1)[:, None]
        middle = (strokes.start + 2 * strokes.control + strokes.end) / 4
        points = {name: getattr(strokes, name) for name in ("start", "control", "end")}
        points = {name: torch.where(share < 1, middle + share * (p - middle), p) for name, p in points.items()}
        points |= {name: torch.zeros_like(width) for name in ("softness", "widening")}
        return replace(strokes, width=width / strokes.scale, opacity=torch.ones_like(width), **points)

    def with_mixtures(self, strokes: Strokes) -> Strokes:
        """Give each stroke the uniform colour of its nearest mixture."""
        color = self.mixtures.color.to(strokes.color)[self.mixture_of(strokes.color)]
        return replace(strokes, color=color, drift=torch.zeros_like(color))

    def stage_of(self, strokes: Strokes) -> Tensor:
        """Compute the stage (N,) of each stroke; stages run from large to small brushes, each from dark to light."""
        return self.brush_of(strokes) * len(self.mixtures) + self.mixture_of(strokes.color)


class StageOrder(Order):
    """Order that puts strokes of later stages on top."""

    every, until = 1, 1.0

    def __init__(self, table: Table) -> None:
        self.table = table

    def depth(self, strokes: Strokes, accuracy: Tensor | None) -> Tensor:
        return self.table.stage_of(strokes).to(strokes.opacity)
