"""Order strokes and paint them: the whole picture at full or reduced size, or only the part that a view shows."""

import math
from typing import Any

import torch
from torch import Tensor, nn
from torch.nn.functional import interpolate

from brushexp.compositing.bands import bands
from brushexp.compositing.layers import Canvas
from brushexp.painting.canvas_memory import CanvasMemory
from brushexp.painting.schedule import Schedule
from brushexp.pictures.focus import resample_weights
from brushexp.plugins.blend.base import Compositor
from brushexp.plugins.loss.base import PaintedView
from brushexp.plugins.order.base import Order, front_to_back
from brushexp.plugins.renderer.base import Renderer
from brushexp.plugins.sampler.base import View
from brushexp.strokes.catalogue import Strokes
from brushexp.system.precision import at_least_single


class Picture(nn.Module):
    """Paints what a step compares with the target, and keeps the last whole picture and its error.

    For some steps, `aim` may replace the painting's own target and ground.
    """

    own_target: Tensor  # (3, H, W) in [0, 1]
    own_background: Tensor  # (3,) colour of the bare canvas
    focus: Tensor | None  # (H, W) weights of the pixels, of mean 1; None for equal weights

    def __init__(self, target: Tensor, focus: Tensor | None, background: Tensor, blend: Compositor) -> None:
        super().__init__()
        self.register_buffer("own_target", target, persistent=False)
        self.register_buffer("own_background", background, persistent=False)
        self.register_buffer("focus", focus, persistent=False)
        self.blend = blend
        self._aim: tuple[Tensor, Tensor] | None = None  # target and ground of the steps; None for the painting's own
        self.renderer: Renderer  # renderer of the strokes, set before the first picture
        self.memory: CanvasMemory | None = None  # the whole picture, while steps compare only parts of it
        self._last: Tensor | None = None  # the last picture, perhaps a smaller one, if the last step compared all of it
        self._small: dict[float, tuple[Tensor, Tensor | None, float]] = {}  # by zoom, what `_goal` returns
        self._zoom = 1.0  # size of the last picture relative to the canvas
        self._error: float | None = math.inf  # error of the last picture; None until it is needed

    @property
    def target(self) -> Tensor:
        """Current target of the steps (3, H, W)."""
        return self.own_target if self._aim is None else self._aim[0]

    @property
    def background(self) -> Tensor:
        """Colour (3,) of the bare canvas during the steps."""
        return self.own_background if self._aim is None else self._aim[1]

    def aim(self, target: Tensor, background: Tensor) -> None:
        """Set the target (3, H, W) and the ground colour (3,) for the next steps."""
        is_other = target is not self.target
        is_own = target is self.own_target and background is self.own_background
        self._aim = None if is_own else (target, background)
        if is_other:
            self._small = {}
            self.memory = None if self.memory is None else self.memory_of(self.memory.picture)

    @property
    def size(self) -> tuple[int, int]:
        """Height and width of the canvas in pixels."""
        return self.own_target.shape[1], self.own_target.shape[2]

    @property
    def error(self) -> float:
        """Mean squared error of the last whole picture; each pixel of a reduced picture counts as a uniform square."""
        if self.memory is not None:
            return self.memory.error
        if self._error is None:
            assert self._last is not None
            target, _, detail = self._goal(self._zoom)
            difference = at_least_single(self._last.to(target.device) - target).flatten()
            mean = float(difference.dot(difference)) / len(difference)  # a third of the time of mse_loss
            self._error = mean + detail
        return self._error

    @property
    def last(self) -> Tensor | None:
        """The last whole picture (3, H, W) that was painted, or None before the first step."""
        if self.memory is not None:
            return self.memory.picture.to(self.target.device)
        return None if self._last is None else self._enlarge(self._last)

    def _enlarge(self, picture: Tensor) -> Tensor:
        picture = picture.to(self.target.device)  # after a fit, Lightning leaves the module on the CPU
        if picture.shape == self.target.shape:
            return picture
        return interpolate(picture[None], self.size, mode="bilinear", align_corners=False)[0]

    def _goal(self, zoom: float) -> tuple[Tensor, Tensor | None, float]:
        """Return the target and focus, averaged to ``zoom`` times their size, and the variance that averaging removes.

        The error of a reduced picture plus this variance of the target is the error of the full-size picture in which
        each reduced pixel has been enlarged to a uniform square.
        """
        if zoom == 1:
            return self.target, self.focus, 0.0
        if zoom not in self._small:
            height, width = (max(1, round(side * zoom)) for side in self.size)
            target = interpolate(self.target[None], (height, width), mode="area")[0].contiguous()
            focus = None if self.focus is None else resample_weights(self.focus, (height, width)).contiguous()
            detail = float(self.target.square().mean() - target.square().mean())
            self._small[zoom] = target, focus, max(0.0, detail)
        return self._small[zoom]

    def at(self, zoom: float) -> "Picture":
        """Return a `Picture` with the same target and focus, averaged to ``zoom`` times their size.

        The new object also holds the last painted picture, if that picture has the same size.
        """
        if zoom == 1:
            return self
        target, focus, _ = self._goal(zoom)
        small = Picture(target, focus, self.background, self.blend)
        small.renderer = self.renderer
        if self._last is not None and self._zoom == zoom:
            small.show(self._last)
        return small

    def show(self, picture: Tensor, zoom: float = 1.0) -> None:
        """Store a whole picture (3, H, W), at ``zoom`` times the size of the canvas, as the last picture."""
        self._last, self._zoom, self._error, self.memory = picture, zoom, None, None

    @torch.no_grad()
    def draw(self, strokes: Strokes, front_to_back: Tensor) -> Tensor:
        """Draw the whole picture (3, H, W) without gradient."""
        image = torch.empty_like(self.target)
        for top, band in bands(strokes, front_to_back, self.size, self.background, self.renderer, self.blend):
            image[:, top : top + band.shape[1]] = band
        return image

    def see(
        self, moving: Strokes, strokes: Strokes, view: View, front_to_back: Tensor, *, accuracy: bool
    ) -> tuple[Canvas, PaintedView]:
        """Paint the part of the picture that a view shows, differentiably with respect to its active strokes.

        ``moving`` are the active strokes, and ``strokes`` are all N strokes. If ``accuracy`` is set, the accuracy of
        the active strokes is also measured.
        """
        if view.active is None:
            return self._see_whole(moving, front_to_back, view.zoom, accuracy)
        if self.memory is None:
            self.memory = self.memory_of(self.draw(strokes, front_to_back))
        self._last = None
        return self.memory.paint(moving, strokes, view, front_to_back, accuracy=accuracy)

    def _see_whole(
        self, moving: Strokes, front_to_back: Tensor, zoom: float, accuracy: bool
    ) -> tuple[Canvas, PaintedView]:
        strokes, (target, focus, _) = moving if zoom == 1 else moving.moved(zoom=zoom), self._goal(zoom)
        size = (target.shape[1], target.shape[2])
        canvas = self.blend(self.renderer(strokes), front_to_back, size, self.background, target if accuracy else None)
        self.show(canvas.image.detach(), zoom)
        return canvas, PaintedView(canvas.image, target, strokes, focus=focus)

    def forget_strokes(self, rows: Tensor | None) -> None:
        """Discard the cached pictures of strokes that have changed; ``rows`` holds their indices."""
        if self.memory is not None and rows is not None:
            self.memory.cache.forget(rows)

    def memory_of(self, picture: Tensor) -> CanvasMemory:
        """Create a canvas memory from a whole picture (3, H, W)."""
        return CanvasMemory(picture, self.target, self.focus, self.background, self.renderer, self.blend)

    def forget(self) -> None:
        """Discard the canvas memory, because the strokes or their renderer have changed."""
        if self.memory is not None:
            self._error, self.memory = self.memory.error, None


class Depth:
    """Orders N strokes by depth every few steps."""

    def __init__(self, order: Order) -> None:
        self.order = order
        self.front_to_back = torch.empty(0, dtype=torch.long)  # (N,) indices of the strokes, top stroke first
        self.accuracy: Tensor | None = None  # (N,) accuracy as last measured, see `Order.depth`

    @torch.no_grad()
    def renew(self, strokes: Strokes) -> None:
        self.front_to_back = front_to_back(self.order.depth(strokes, self.accuracy))

    @torch.no_grad()
    def revise(self, keep: Tensor, new: int) -> None:
        """Remove strokes where ``keep`` (N,) is false, keep the order of the rest, and add ``new`` strokes on top."""
        before = self.front_to_back.to(keep.device)  # after a fit, Lightning leaves the strokes on the processor
        stay = before[keep[before]]
        added = torch.arange(len(stay), len(stay) + new, device=stay.device).flip(0)
        self.front_to_back = torch.cat([added, (keep.cumsum(0) - 1)[stay]])
        if self.accuracy is not None:
            self.accuracy = torch.cat([self.accuracy[keep], self.accuracy.new_ones(new)])

    def needs_accuracy(self, schedule: Schedule, *, partial: bool) -> bool:
        """Return whether a step must measure the accuracy that the order needs.

        It must do so in the step before the strokes are reordered, and in every partial update.
        """
        done, steps = schedule.stage_progress
        return self.order.needs_accuracy and (partial or self.order.due(done + 1, steps))

    def note_accuracy(self, accuracy: Tensor | None, rows: Tensor | None, n: int) -> None:
        """Record the accuracy of the strokes with indices ``rows``, or of all ``n`` strokes, where it is not NaN."""
        if accuracy is None:
            return
        if self.accuracy is None:
            self.accuracy = accuracy.new_zeros(n)
        index = slice(None) if rows is None else rows
        self.accuracy[index] = torch.where(accuracy.isnan(), self.accuracy[index], accuracy)

    def state_dict(self) -> dict[str, Any]:
        return {"front_to_back": self.front_to_back, "accuracy": self.accuracy}

    def load_state_dict(self, state: dict[str, Any], device: torch.device) -> None:
        self.front_to_back = state["front_to_back"].to(device)
        self.accuracy = None if state["accuracy"] is None else state["accuracy"].to(device)
