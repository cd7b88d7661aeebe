"""Remove hairlines, strokes that cross all their neighbours, and isolated marks."""

import math
from dataclasses import dataclass, field
from typing import Annotated, Any

import torch
from torch import Tensor

from brushexp.bounds import at_least, between
from brushexp.plugins.density._lone_marks import find_lone_marks
from brushexp.plugins.density._rounds import CHANNELS
from brushexp.plugins.density.base import DensificationState, DensificationUpdate, Density
from brushexp.registry import register
from brushexp.strokes.bezier import half_width_of, length_of, shape_of
from brushexp.strokes.catalogue import Strokes
from brushexp.strokes.measures import area_of, direction_of, mean_direction, neighbours_of

MIN_COHERENCE = 0.5  # shortest mean direction of the neighbours; ten random directions give about 0.28


@register("density", "strays")
@dataclass(kw_only=True)
class Strays(Density):
    """Removes hairlines, strokes that cross all their neighbours, and isolated marks that the picture hardly needs.

    Strokes are removed only once, and the remaining steps then close the gaps. A stroke is hardly needed if its removal
    increases the squared error only a little, relative to its area. An isolated mark, such as a spot or a tick, stays
    if it is in the focus, or if the target also stands out from its surroundings there. Strokes that depict eyes and
    mouths also stay.

    Args:
        after: fraction of the steps after which strays are removed.
        thin: thickness in pixels below which a stroke is a hairline.
        askew: angle in degrees between a stroke and the mean direction of its ten nearest neighbours, above which it
            crosses them.
        missed: root mean square error, 0 to 1, that the removal of a stray may add over its area.
        lone: smallest difference between the picture and its surroundings, 0 to 1, that justifies an isolated mark; 0
            keeps all marks.
    """

    after: Annotated[float, between(0, 1)] = 0.7
    thin: Annotated[float, at_least(0)] = 1.5
    askew: Annotated[float, between(0, 90)] = 50
    missed: Annotated[float, between(0, 1)] = 0.04
    lone: Annotated[float, between(0, 1)] = 0.1
    _done: bool = field(default=False, init=False)
    uses_importance = True

    def due(self, step: int, steps: int) -> bool:
        return not self._done and step >= max(1, round(self.after * steps))

    def revise(self, state: DensificationState) -> DensificationUpdate | None:
        self._done, strokes = True, state.strokes
        shape, width = shape_of(strokes), 2 * half_width_of(strokes)
        direction = direction_of(shape)
        around = mean_direction(direction, neighbours_of(strokes, shape))
        strength = around.norm(dim=1)
        cosine = (direction * around).sum(1) / strength.clamp_min(torch.finfo(around.dtype).tiny)  # twice the angle
        crossing = (strength > MIN_COHERENCE) & (cosine < math.cos(math.radians(2 * self.askew)))
        stray = (width < self.thin) | crossing
        if stray.any():
            allowed = CHANNELS * self.missed**2 * area_of(length_of(shape), width)
            stray &= state.importance() < allowed
        if self.lone:
            lone = find_lone_marks(strokes, state.image, state.target, self.lone)
            stray |= lone & ~_in_focus(strokes, state.focus)
        if state.features is not None:
            stray &= ~_at_places(strokes, state.features)
        return DensificationUpdate(~stray, Strokes.none(width)) if stray.any() and not stray.all() else None

    def state_dict(self) -> dict[str, Any]:
        return {"done": self._done}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        self._done = state["done"]


def _in_focus(strokes: Strokes, focus: Tensor | None) -> Tensor:
    """Mark the strokes (N,) at whose positions ``focus`` (H, W) is closer to its maximum than to its minimum."""
    if focus is None:
        return torch.zeros_like(strokes.opacity, dtype=torch.bool)
    return _at_places(strokes, focus) > (focus.min() + focus.max()) / 2


def _at_places(strokes: Strokes, values: Tensor) -> Tensor:
    """Read the values (N,) of a map (H, W) at the positions of strokes."""
    x, y = (strokes.position[:, k].long().clamp(0, values.shape[1 - k] - 1) for k in range(2))
    return values[y, x]
