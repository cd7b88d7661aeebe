"""Losses that keep strokes calm: hardly bent, and lying as their neighbours do."""

from typing import Any

import torch
from torch import Tensor

from brushexp.errors import UserError
from brushexp.plugins.loss._precision import at_least_single
from brushexp.plugins.loss.base import Loss, Painting
from brushexp.registry import register
from brushexp.strokes.bezier import curve_of, point_at
from brushexp.strokes.catalogue import Strokes
from brushexp.strokes.neighbours import NEIGHBOURS, nearest
from brushexp.strokes.prior import SHORTEST


@register("loss", "curvature")
class Curvature(Loss):
    """Mean of |(s - c) + (e - c)| / |e - s|, how far each stroke bends against its length; 0 if all are straight.

    Source: Kotovenko et al., 2021, arXiv:2103.17185. Twice the distance of the control point from the middle of the
    ends, in lengths of the chord; also a stroke with its control point off the middle of a straight line counts.
    Differs from the source: |e - s| is at least that of the shortest valid stroke (`strokes.prior.SHORTEST`), so that
    value and gradient stay finite where the ends coincide, which the source forbids by an epsilon.

    Args:
        weight: factor in the sum of losses; the source's 4 is for other units. On a portrait of 256 pixels, 655 strokes
            and 150 steps, ``mse`` alone left a mean of 1.2, with the default of this loss 0.4 at a cost of 0.15 dB;
            0.0001 left 0.5 (0.1 dB), 0.001 left 0.1 (0.2 dB).
    """

    looks_at = "strokes"

    def __init__(self, *, weight: float = 0.0002) -> None:
        super().__init__()
        self.weight = weight

    def forward(self, painting: Painting) -> Tensor:
        return bends(painting.strokes.map(at_least_single)).sum() / max(len(painting.strokes), 1)


@register("loss", "direction")
class Direction(Loss):
    """Mean squared difference between the directions of each stroke and its nearest ones: they flow together.

    Source: Kotovenko et al., 2021, arXiv:2103.17185. The direction of a stroke is (dx^2, dy^2, dx dy) of d = e - s, in
    which d and -d are the same; squared differences are summed over the three and averaged over all pairs. Strokes
    count as near whose curves have their middles near. Differs from the source: d is in units of the root mean square
    length of all strokes, so that neither the size of the canvas nor that of the strokes changes the value, and making
    all strokes shorter does not lower it. (That length counts as at least that of the shortest valid strokes in the
    same windows, which keeps everything finite where all strokes are points.)

    Args:
        weight: factor in the sum of losses; the source's 0.008 is for other units. On a portrait of 256 pixels, 655
            strokes and 150 steps, ``mse`` alone left 2.0, with the default of this loss 0.7 at a cost of less than
            0.1 dB; 0.001 left 0.3 and cost 0.4 dB.
        k: neighbours of a stroke; of fewer strokes, all others.
        every: the neighbours are found anew at every so many calls, and whenever the number of strokes has changed.
    """

    looks_at = "strokes"

    def __init__(self, *, weight: float = 0.0001, k: int = NEIGHBOURS, every: int = 20) -> None:
        super().__init__()
        for name, value in (("k", k), ("every", every)):
            if value < 1:
                raise UserError(
                    f"loss.direction.{name}={value} is not a number from 1; try loss.direction.{name}={NEIGHBOURS}"
                )
        self.weight = weight
        self.k, self.every = k, every
        self.calls = 0
        self.neighbours = torch.empty(0, 0, dtype=torch.long)  # (N, k) strokes nearest to each

    def forward(self, painting: Painting) -> Tensor:
        strokes = painting.strokes.map(at_least_single)
        if self.calls % self.every == 0 or len(self.neighbours) != len(strokes):
            middles = point_at(curve_of(strokes), strokes.scale.new_tensor(0.5))
            self.neighbours = nearest(middles, middles, self.k, exclude_self=True)
        self.calls += 1
        found = orientations(strokes)
        difference = found[:, None] - found[self.neighbours.to(found.device)]  # (N, k, 3)
        return difference.square().sum() / max(self.neighbours.numel(), 1)

    def get_extra_state(self) -> dict[str, Any]:
        """What an interrupted run needs to continue exactly."""
        return {"calls": self.calls, "neighbours": self.neighbours}

    def set_extra_state(self, state: dict[str, Any]) -> None:
        """Inverse of `get_extra_state`."""
        self.calls, self.neighbours = state["calls"], state["neighbours"]


def bends(strokes: Strokes) -> Tensor:
    """|(s - c) + (e - c)| / |e - s| of each stroke (N,); the slope of a straight one is 0."""
    offset = strokes.start + strokes.end - 2 * strokes.control
    square = offset.square().sum(1)
    nothing = (square == 0).to(square)
    chord = (strokes.end - strokes.start).square().sum(1).clamp_min(SHORTEST**2)
    return ((square + nothing).sqrt() - nothing) / chord.sqrt()


def orientations(strokes: Strokes) -> Tensor:
    """(dx^2, dy^2, dx dy) of each stroke (N, 3), d from end to end in units of the root mean square of all |d|."""
    chord = (strokes.end - strokes.start) * (0.5 * strokes.scale)[:, None]  # pixels
    least = 0.25 * SHORTEST**2 * strokes.scale.square().mean().detach()
    x, y = (chord / torch.maximum(chord.square().sum(1).mean(), least).sqrt()).unbind(1)
    return torch.stack([x.square(), y.square(), x * y], dim=1)
