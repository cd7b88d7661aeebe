"""Which stroke lies on top, renewed every few steps, and the accuracy that an order may need for it."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from brushexp.painting.schedule import Schedule
from brushexp.plugins.order.base import Order, front_to_back
from brushexp.strokes.catalogue import Strokes


class Depth:
    """The depth of N strokes, as an order computes it.

    Attributes:
        front_to_back: (N,) indices of the strokes, the uppermost first.
        accuracy: (N,) of each stroke when it was last measured, see `Order.depth`; None before that.
    """

    def __init__(self, order: Order) -> None:
        self.order = order
        self.front_to_back = torch.empty(0, dtype=torch.long)
        self.accuracy: Tensor | None = None

    @torch.no_grad()
    def renew(self, strokes: Strokes) -> None:
        """Compute the depth of strokes as they are now."""
        self.front_to_back = front_to_back(self.order.depth(strokes, self.accuracy))

    def needs_accuracy(self, schedule: Schedule, *, partial: bool) -> bool:
        """Whether this step has to measure accuracy: before a renewal, and for a part of the strokes always."""
        done, steps = schedule.stage_progress
        return self.order.needs_accuracy and (partial or self.order.due(done + 1, steps))

    def measured(self, accuracy: Tensor | None, rows: Tensor | None, n: int) -> None:
        """Take over the accuracy of strokes number ``rows`` of ``n``, all for None; NaN says nothing."""
        if accuracy is None:
            return
        if self.accuracy is None:
            self.accuracy = accuracy.new_zeros(n)
        seen = slice(None) if rows is None else rows
        self.accuracy[seen] = torch.where(accuracy.isnan(), self.accuracy[seen], accuracy)

    def state_dict(self) -> dict[str, Any]:
        """What an interrupted run needs to go on."""
        return {"front_to_back": self.front_to_back, "accuracy": self.accuracy}

    def load_state_dict(self, state: dict[str, Any], device: torch.device) -> None:
        """Take over what `state_dict` gave."""
        self.front_to_back = state["front_to_back"].to(device)
        self.accuracy = None if state["accuracy"] is None else state["accuracy"].to(device)
