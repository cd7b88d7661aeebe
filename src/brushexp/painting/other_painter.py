"""Run painters that yield a sequence of states instead of taking gradient steps."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from types import MappingProxyType
from typing import Any

import torch
from torch import Tensor

from brushexp.errors import UserError
from brushexp.painting.components import Components
from brushexp.painting.painting_module import PaintingModule
from brushexp.painting.picture import Picture
from brushexp.painting.schedule import Schedule
from brushexp.plugins.change.base import Change
from brushexp.plugins.painter.base import Painter, PaintRequest, PaintState
from brushexp.registry.blame import name_member
from brushexp.strokes.bezier import strokes_along
from brushexp.strokes.catalogue import Strokes, check_strokes


class OtherPainter(PaintingModule):
    """Draws the states that a painter yields, one per step, with the renderer of the last stage.

    The clock is stopped while a state is drawn.
    """

    def __init__(
        self, painter: Painter, components: Components, target: Tensor, background: Tensor, *, n: int, seed: int,
        changes: Mapping[str, Change] = MappingProxyType({}),
    ) -> None:  # fmt: skip
        picture = Picture(target, None, background, components.blend)
        changes = {name: change for name, change in changes.items() if change.for_all_painters}
        super().__init__(components, picture, Schedule([1]), seed=seed, changes=changes)
        self.painter, self.n = painter, n
        self.picture.renderer = components.stages[-1].renderer
        self._strokes = Strokes.none(target)
        self._states = self._paint()

    def strokes(self) -> Strokes:
        return self._here(self._strokes)

    def _here(self, strokes: Strokes) -> Strokes:
        return strokes.map(lambda value: value.to(self.device))

    def draw_strokes(self, strokes: Strokes) -> Tensor:
        """Draw strokes, bottom first, as a picture (3, H, W), differentiable in fields that require a gradient."""
        strokes = self._here(strokes)
        order = torch.arange(len(strokes) - 1, -1, -1, device=self.device)
        if not (torch.is_grad_enabled() and any(value.requires_grad for _, value in strokes.items())):
            return self.picture.draw(strokes, order)
        return self.components.blend(self.renderer(strokes), order, self.picture.size, self.picture.background).image

    def prepare(self) -> None:
        canvas = self.picture
        middle = canvas.target.new_tensor(canvas.size[::-1]).div(2).expand(1, 3, 2)
        width, color = canvas.target.new_ones(1), canvas.target.new_zeros(1, 3)
        stroke = strokes_along(middle, width.requires_grad_(self.painter.differentiates), color, width.detach())
        with torch.set_grad_enabled(self.painter.differentiates):
            image = self.draw_strokes(stroke)
            if self.painter.differentiates:
                image.sum().backward()

    def _paint(self) -> Iterator[PaintState]:
        canvas, state = self.picture, PaintState(self._strokes, 0, 1)
        request = PaintRequest(canvas.target, self.n, canvas.background, self.draw_strokes, self.generator)
        for state in self.painter(request):
            self._check(state)
            yield state
        yield PaintState(state.strokes, state.step, state.step)  # the painter may finish earlier than planned

    def configure_optimizers(self) -> Any:
        return torch.optim.SGD([torch.zeros(1)], lr=0.0)  # no parameters to move

    def training_step(self, batch: int, batch_idx: int) -> None:
        """Draw the next state of the painter."""
        state = next(self._states)
        self.schedule.pause()
        self._show(state)
        self.publish()
        optimizer: Any = self.optimizers()
        optimizer.step()  # so that Lightning counts steps
        self.schedule.start()

    @torch.no_grad()
    def _show(self, state: PaintState) -> None:
        """Draw a state, and store its strokes and picture."""
        strokes = self.renderer.convert(state.strokes.map(Tensor.detach))
        image = self.draw_strokes(strokes)
        if not image.isfinite().all():
            who = f"{name_member('renderer', self.renderer)} with {name_member('blend', self.picture.blend.blend)}"
            raise UserError(f"{who} makes a picture that is not finite; choose others")
        self._strokes = strokes
        self.depth.front_to_back = torch.arange(len(strokes) - 1, -1, -1, device=self.device)
        self.schedule.step, self.schedule.ends = state.step, [max(state.step, state.steps)]
        self.picture.show(image)

    def _check(self, state: Any) -> None:
        who = name_member("painter", self.painter)
        if not isinstance(state, PaintState):
            raise UserError(f"{who} yielded {type(state).__name__}, not a PaintState; correct the painter")
        try:
            check_strokes(state.strokes)
        except UserError as error:
            raise UserError(f"{who} yielded an invalid stroke: {error}; correct the painter") from error
        if len(state.strokes) > self.n:
            raise UserError(
                f"{who} yielded {len(state.strokes)} strokes, but {self.n} are allowed; correct the painter"
            )
