"""Alignment of neighbouring strokes as a loss."""

from typing import Annotated, Any

import torch
from torch import Tensor

from brushexp.contracts import at_least, register
from brushexp.contracts.families import Loss, PaintedView
from brushexp.contracts.strokes import NEIGHBOURS, at_least_single, direction_of, neighbours_of, shape_of


@register("loss", "direction")
class Direction(Loss):
    """Mean squared difference in direction between each stroke and its nearest neighbours; aligns the strokes.

    Source: Kotovenko et al., 2021, arXiv:2103.17185, who compare (dx^2, dy^2, dx dy) of d = e - s. Unlike in the
    source, the direction is (cos 2 theta, sin 2 theta) of the principal axis (`strokes.measures.direction_of`), so that
    lengths do not matter. The loss is the mean of 4 sin^2 of the angle between neighbours: 0 if all strokes are
    parallel, and 2 if their directions are random.

    Args:
        weight: factor in the sum of losses; the source's 0.008 applies to other units. On a portrait, the final value
            of this loss was 1.32 with ``mse`` alone, 0.79 with the default weight (at a cost of 0.1 dB), and 1.04 with
            a weight of 0.0001 (less than 0.1 dB).
        k: number of neighbours per stroke, or all other strokes if there are fewer.
        every: number of calls between searches for neighbours; a change in the number of strokes also triggers a
            search.
    """

    weight = 0.0003
    cost = "0.6 x mse"
    looks_at = "strokes"

    def __init__(self, *, k: Annotated[int, at_least(1)] = NEIGHBOURS, every: Annotated[int, at_least(1)] = 20) -> None:
        super().__init__()
        self.k, self.every = k, every
        self.calls = 0
        self.neighbours = torch.empty(0, 0, dtype=torch.long)  # (N, k) strokes nearest to each

    def forward(self, view: PaintedView) -> Tensor:
        strokes = view.strokes.map(at_least_single)
        shape = shape_of(strokes)
        if self.calls % self.every == 0 or len(self.neighbours) != len(strokes):
            self.neighbours = neighbours_of(strokes, shape, self.k)
        self.calls += 1
        direction = direction_of(shape)
        difference = direction[:, None] - direction[self.neighbours.to(direction.device)]  # (N, k, 2)
        return difference.square().sum() / max(self.neighbours.numel(), 1)

    def get_extra_state(self) -> dict[str, Any]:
        return {"calls": self.calls, "neighbours": self.neighbours}

    def set_extra_state(self, state: dict[str, Any]) -> None:
        self.calls, self.neighbours = state["calls"], state["neighbours"]
