"""Simulate a watercolour wash, whose pigment gathers at the edge because the edge dries first."""

import math
from dataclasses import dataclass
from typing import Annotated

import numpy as np
import torch
from torch import Tensor

from brushexp.contracts import between, register
from brushexp.contracts.families import Engine, Simulated
from brushexp.contracts.strokes import closest_parameter, point_at, strokes_of

FARTHEST_POINT = 4.0  # half-windows
THINNEST_STROKE, WIDEST_STROKE = 0.01, 4.0  # windows
PERIOD = 64  # period of a stroke's noise in cells
COARSE, FINE = 1.2, 0.1  # size of a noise cell for the wandering outline and for the paper's grain, in half widths
RIM = 0.14  # distance from the edge at which the rim has faded to 1/e, in half widths
SOFT = 0.06  # width of the outline's ramp, in half widths


@register("engine", "wash")
@dataclass(kw_only=True, eq=False)
class Wash(Engine):
    """A flat wash with a dark rim and the grain of paper; the paint is thin and therefore has no height.

    Two effects are taken from Curtis et al. (1997, "Computer-generated watercolor"): edge darkening, because water
    carries pigment to the drying edge, and granulation in the hollows of the paper. Unlike in the source, nothing
    flows: both effects are computed from the distance to the stroke's edge.

    Args:
        window: side of a picture in pixels, 8 to 1024.
        film: coverage in the middle of a stroke, 0 to 1.
        rim: additional coverage at the edge of a stroke, 0 to 1.
        grain: variation in coverage caused by the paper, as a fraction of the coverage, 0 to 1.
        wander: irregularity of the outline, in half widths, 0 to 0.5.
    """

    window: Annotated[int, between(8, 1024)] = 64
    film: Annotated[float, between(0, 1)] = 0.5
    rim: Annotated[float, between(0, 1)] = 0.45
    grain: Annotated[float, between(0, 1)] = 0.12
    wander: Annotated[float, between(0, 0.5)] = 0.15

    def __call__(self, parameters: Tensor, *, seed: int, first: int = 0) -> Simulated:
        parameters = parameters.detach().cpu().float()
        strokes = (self._coverage(parameters[i : i + 1], seed, first + i) for i in range(len(parameters)))
        alpha = torch.cat([torch.empty(0, self.window, self.window), *strokes])
        color = strokes_of(parameters).color.clamp(0, 1)[:, :, None, None].expand(-1, -1, *alpha.shape[1:])
        return Simulated(torch.cat([color, alpha[:, None]], dim=1), (alpha > 0).float())

    def _coverage(self, parameters: Tensor, seed: int, number: int) -> Tensor:
        """Compute the coverage (1, S, S) of a single stroke (1, 10), independently of other strokes in the batch."""
        strokes, pixel = strokes_of(parameters), torch.arange(self.window) + 0.5 - 0.5 * self.window
        points = torch.stack(torch.meshgrid(pixel, pixel, indexing="xy"), dim=-1).reshape(-1, 2)
        curve = torch.stack([strokes.start, strokes.control, strokes.end], dim=1).clamp(-FARTHEST_POINT, FARTHEST_POINT)
        curve = (0.5 * self.window * curve).expand(len(points), -1, -1)
        half = 0.5 * self.window * strokes.width.clamp(THINNEST_STROKE, WIDEST_STROKE)
        away = (point_at(curve, closest_parameter(curve, points)) - points).norm(dim=-1) / half
        source = np.random.Generator(np.random.Philox(key=np.array([seed, number], np.uint64)))
        outline, paper = torch.from_numpy(source.standard_normal((2, PERIOD, PERIOD), np.float32))
        place = points / half
        inside = 1 + self.wander * (_look_up(outline, place / COARSE) - 1).clamp(-2, 0) - away  # half widths
        film = self.film + self.rim * torch.exp(-(inside / RIM).clamp_min(0))
        film = film * (1 + self.grain * _look_up(paper, place / FINE))
        return (film * (inside / SOFT + 0.5).clamp(0, 1)).clamp(0, 1).reshape(1, self.window, self.window)


def _look_up(noise: Tensor, place: Tensor) -> Tensor:
    """Interpolate periodic noise (PERIOD, PERIOD) smoothly at points (P, 2), which are given in cells."""
    cell = place.floor()
    share = 0.5 - 0.5 * torch.cos(math.pi * (place - cell))
    column, row = cell.long().unbind(-1)
    above, below = (
        torch.lerp(noise[down % PERIOD, column % PERIOD], noise[down % PERIOD, (column + 1) % PERIOD], share[:, 0])
        for down in (row, row + 1)
    )
    return torch.lerp(above, below, share[:, 1])
