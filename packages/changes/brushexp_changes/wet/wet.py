"""Paint wet-on-wet: drag paint along finished strokes and, optionally, optimise the strokes for the wet painting."""

from dataclasses import dataclass, field
from typing import Annotated, Any

import torch
from omegaconf import DictConfig
from torch import Tensor

from brushexp.contracts import at_least, between, register
from brushexp.contracts.families import Change, PaintingState
from brushexp.contracts.strokes import Strokes
from brushexp_changes.steps import check_steps
from brushexp_changes.wet.dragging import drag_paint


@register("change", "wet")
@dataclass(kw_only=True)
class Wet(Change):
    """Wet-on-wet: strokes pick up the paint under their starts and drag it until it runs out (for example ``wet=0.5``).

    With ``every``, strokes are optimised for the wet painting. Every few steps, paint is dragged as a trial, and the
    dry strokes are then optimised to match target + dry - wet. This results in the gradient of the wet painting if
    dragging is treated as independent of the strokes (straight-through estimator; Bengio, Léonard and Courville, 2013).
    Curves show the resulting estimate of the wet painting's error.

    Args:
        amount: fraction of the underlying colour that a stroke drags along, 0 to 1.
        every: number of steps between updates of the wet painting; null = optimise dry paint only.
        after: fraction of the steps before the first update, during which strokes settle.
    """

    rank = 10  # this change runs after the changes that set final colours
    for_all_painters = True

    amount: Annotated[float, between(0, 1)] = 0.5
    every: Annotated[int, at_least(1, typical=10)] | None = None
    after: Annotated[float, between(0, 1)] = 0.2
    _lack: Tensor | None = field(default=None, init=False, repr=False)  # (3, H, W) dry - wet at the last update
    _aimed: tuple[Tensor, Tensor] | None = field(default=None, init=False, repr=False)  # target, and target + dry - wet

    def check(self, cfg: DictConfig, size: tuple[int, int]) -> None:
        if self.every is not None:
            check_steps(cfg, f"change.wet.every={self.every}")

    def aim(self, target: Tensor, ground: Tensor, state: PaintingState) -> tuple[Tensor, Tensor]:
        if self._is_due(state):
            self._look(state)
        if self._lack is None:
            return target, ground
        if self._aimed is None or self._aimed[0] is not target:
            self._aimed = target, (target + self._lack.to(target)).clamp(0, 1)
        return self._aimed[1], ground

    def _is_due(self, state: PaintingState) -> bool:
        if not self.amount or self.every is None or state.is_coarse or state.step % self.every:
            return False
        return state.step > 0 and self.after * state.steps <= state.step

    @torch.no_grad()
    def _look(self, state: PaintingState) -> None:
        strokes, order = state.strokes(), state.front_to_back
        wet = state.draw(*drag_paint(strokes, order, state, self.amount))
        self._lack, self._aimed = state.draw(strokes, order) - wet, None

    def end(self, strokes: Strokes, front_to_back: Tensor, state: PaintingState) -> tuple[Strokes, Tensor]:
        return drag_paint(strokes, front_to_back, state, self.amount)

    def state_dict(self) -> dict[str, Any]:
        return {"lack": self._lack}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        self._lack, self._aimed = state.get("lack"), None
