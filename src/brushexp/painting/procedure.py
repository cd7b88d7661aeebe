"""Paintings that come to be otherwise than by gradient steps: a method yields states, all around is the same."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import torch
from torch import Tensor

from brushexp.errors import UserError
from brushexp.painting.components import Components
from brushexp.painting.divergence import named
from brushexp.painting.painting_module import PaintingModule
from brushexp.painting.picture import Picture
from brushexp.painting.schedule import Schedule
from brushexp.plugins.painter.base import Commission, PaintingMethod, PaintingState
from brushexp.strokes.bezier import strokes_along
from brushexp.strokes.catalogue import Strokes, check_strokes

END = object()  # instead of a state


class Procedure(PaintingModule):
    """Takes one state after another from a painting method; a step of the Trainer is a state.

    The renderer is that of the last stage. What it cannot draw it converts, in every state. The clock stands still
    while a state is drawn to be looked at.
    """

    def __init__(
        self, method: PaintingMethod, components: Components, target: Tensor, background: Tensor, *, n: int, seed: int
    ) -> None:
        super().__init__(components, Picture(target, None, background, components.blend), Schedule([1]))
        self.automatic_optimization = False
        self.method, self.n, self.seed = method, n, seed
        self.picture.renderer = components.stages[-1].renderer
        self._states: Iterator[PaintingState] = iter(())
        self._state = PaintingState(Strokes.none(target), 0, 1)

    def strokes(self) -> Strokes:
        return self._state.strokes

    def draw(self, strokes: Strokes) -> Tensor:
        """The picture (3, H, W) of strokes, the lowest first; differentiable in those that want a gradient."""
        order = torch.arange(len(strokes) - 1, -1, -1, device=self.device)
        if not (torch.is_grad_enabled() and any(value.requires_grad for _, value in strokes.items())):
            return self.picture.draw(strokes, order)
        return self.components.blend(self.renderer(strokes), order, self.picture.size, self.picture.background).image

    def prepare(self) -> None:
        """Compile what draws, and let the method begin, which does nothing before its first state is asked for."""
        canvas = self.picture
        middle = canvas.target.new_tensor(canvas.size[::-1]).div(2).expand(1, 3, 2)
        width, color = canvas.target.new_ones(1), canvas.target.new_zeros(1, 3)
        stroke = strokes_along(middle, width.requires_grad_(self.method.differentiates), color, width.detach())
        with torch.set_grad_enabled(self.method.differentiates):
            seen = self.draw(stroke)
            if self.method.differentiates:
                seen.sum().backward()
        generator = torch.Generator().manual_seed(self.seed)
        self._states = self.method(Commission(canvas.target, self.n, canvas.background, self.draw, generator))

    def configure_optimizers(self) -> Any:
        return []

    def training_step(self, batch: Any, batch_idx: int) -> None:
        """Ask for the next state, and draw it."""
        state = next(self._states, END)
        self.schedule.pause()
        if state is END:  # nothing more came of it than was said
            self.schedule.ends = [self.schedule.step]
        else:
            self._show(state)
        self.schedule.start()
        self._curves.step_taken(self)

    @torch.no_grad()
    def _show(self, state: Any) -> None:
        self._check(state)
        strokes = self.renderer.convert(state.strokes.map(lambda value: value.detach().to(self.device)))
        shown = self.draw(strokes)
        if not shown.isfinite().all():
            who = f"{named('renderer', self.renderer)} with {named('blend', self.components.blend.blend)}"
            raise UserError(f"{who} makes a picture that is not finite; choose others")
        self._state = PaintingState(strokes, state.step, state.steps)
        self.depth.front_to_back = torch.arange(len(strokes) - 1, -1, -1, device=self.device)
        self.schedule.step, self.schedule.ends = state.step, [max(state.step, state.steps)]
        self.picture.show(shown)

    def _check(self, state: Any) -> None:
        """Refuse (UserError) what is no state, or has strokes that are none or too many."""
        who = named("painter", self.method)
        if not isinstance(state, PaintingState):
            raise UserError(f"{who} yields {type(state).__name__}, not a PaintingState; correct the painter")
        try:
            check_strokes(state.strokes)
        except UserError as error:
            raise UserError(f"{who} yields strokes of which one is none: {error}; correct the painter") from error
        if len(state.strokes) > self.n:
            raise UserError(f"{who} yields {len(state.strokes)} strokes, not {self.n} at most; correct the painter")

    def on_train_batch_end(self, outputs: Any, batch: Any, batch_idx: int) -> None:
        counted = self.trainer.fit_loop.epoch_loop.manual_optimization.optim_step_progress
        counted.increment_ready()  # Lightning counts the steps of optimisers
        counted.increment_completed()
        super().on_train_batch_end(outputs, batch, batch_idx)
