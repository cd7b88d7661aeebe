"""The optimisation: gradient steps over the catalogue, as a LightningModule."""

import logging
import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import accumulate
from typing import Any

import lightning as L
import torch
from torch import Tensor, nn, optim

from brushexp.blend.base import Blend, Canvas
from brushexp.density.base import Density
from brushexp.loss.base import Loss, Painting
from brushexp.optimizer.base import Optimizer
from brushexp.order.base import Order, front_to_back
from brushexp.paint.metrics import psnr_of
from brushexp.renderer.base import Renderer
from brushexp.sampler.base import Region, Sampler
from brushexp.strokes.bezier import curve_of, half_width_of
from brushexp.strokes.catalogue import Catalogue, Strokes

log = logging.getLogger(__name__)
SECONDS_PER_CALL = 0.2  # one training step of Lightning takes as many gradient steps as fit, so that its own cost hides
MOVED = 0.01  # pixels by which a stroke may change without being counted


@dataclass(frozen=True)
class Stage:
    """So many steps with one renderer.

    Attributes:
        name: of the renderer, for messages.
        renderer: draws the strokes.
        steps: gradient steps.
    """

    name: str
    renderer: Renderer
    steps: int


@dataclass(frozen=True)
class Parts:
    """What a painting is made with: one member of each family, but one renderer for each stage."""

    stages: Sequence[Stage]
    blend: Blend
    order: Order
    losses: Mapping[str, Loss]
    density: Density
    sampler: Sampler
    optimizer: Optimizer


class Painter(L.LightningModule):
    """Moves strokes until the picture matches the target. Renderers stay frozen.

    The steps go through the stages one after another. When one begins, its renderer adopts the strokes and the
    optimiser starts afresh; the learning rate goes once through its schedule in each.

    Args:
        catalogue: the strokes.
        parts: how they are drawn, compared and moved.
        target: (3, H, W) in [0, 1].
        background: (3,) colour of the bare canvas.
        seed: of everything random in the steps.
        watch: called after every step with the number of steps done.
    """

    target: Tensor
    background: Tensor
    accuracy: Tensor
    front_to_back: Tensor

    def __init__(
        self,
        catalogue: Catalogue,
        parts: Parts,
        target: Tensor,
        background: Tensor,
        *,
        seed: int,
        watch: Callable[[int], None] = lambda step: None,
    ) -> None:
        super().__init__()
        self.automatic_optimization = False
        self.strict_loading = False  # frozen networks are not in the checkpoint
        self.catalogue = catalogue
        self.parts = parts
        self.renderers = nn.ModuleList(stage.renderer.requires_grad_(False) for stage in parts.stages)
        self.ends = list(accumulate(stage.steps for stage in parts.stages))  # step at which each stage is over
        self.losses = nn.ModuleDict(parts.losses)
        self.register_buffer("target", target, persistent=False)
        self.register_buffer("background", background, persistent=False)
        self.watch = watch
        self.generator = torch.Generator().manual_seed(seed)
        self.step = 0
        self.stop = ""  # set from outside: finish after the present step, for this reason
        self.seconds = 0.0  # of wall time in the fit so far
        self.terms: dict[str, Tensor] = {}  # the losses of the last step, unweighted
        self._last: tuple[Tensor, Tensor] | None = None  # picture and target that the last step compared
        self._accuracy: Tensor | None = None
        self._adopt()

    @property
    def steps(self) -> int:
        """Gradient steps in all."""
        return self.ends[-1]

    @property
    def stage(self) -> int:
        """Number of the present stage; after the last step, of the last one."""
        return next((k for k, end in enumerate(self.ends) if self.step < end), len(self.ends) - 1)

    @property
    def progress(self) -> tuple[int, int]:
        """Steps of the present stage that are done, and all of them."""
        begin = self.ends[self.stage - 1] if self.stage else 0
        return self.step - begin, self.ends[self.stage] - begin

    @property
    def renderer(self) -> Renderer:
        """That of the present stage."""
        return self.parts.stages[self.stage].renderer

    @property
    def size(self) -> tuple[int, int]:
        """Height and width of the canvas."""
        return int(self.target.shape[1]), int(self.target.shape[2])

    @property
    def error(self) -> float:
        """Mean squared error of the region that the last step looked at, as it was before the step."""
        return math.inf if self._last is None else float((self._last[0] - self._last[1]).square().mean())

    def paint(self, region: Region, *, judge: bool = False) -> tuple[Canvas, Painting]:
        """The picture of a region as it is now, differentiable in the catalogue."""
        rows, columns = (slice(region.top, region.top + region.height), slice(region.left, region.left + region.width))
        whole = (region.height, region.width) == self.size
        target = self.target if whole else self.target[:, rows, columns]
        strokes = self.catalogue()
        layers = self.renderer(strokes.moved(shift=(-region.left, -region.top)))
        canvas = self.parts.blend(
            layers, self.front_to_back, (region.height, region.width), self.background, target if judge else None
        )
        return canvas, Painting(canvas.image, target, strokes)

    @torch.no_grad()
    def picture(self) -> Tensor:
        """The whole picture (3, H, W) now."""
        return self.paint(Region(0, 0, *self.size))[0].image

    def latest(self) -> Tensor:
        """The whole picture as the last step saw it, if it looked at all of it; else as it is now."""
        if self._last is not None and tuple(self._last[0].shape[1:]) == self.size:
            return self._last[0]
        return self.picture()

    def end_stage(self) -> bool:
        """Leave out what is left of the present stage; False if it is the last one."""
        stage = self.stage
        if stage == len(self.ends) - 1:
            return False
        left = self.ends[stage] - self.step
        self.ends[stage:] = [end - left for end in self.ends[stage:]]
        return True

    def end_all_but_last(self) -> None:
        """Hand the strokes over to the last renderer, whatever the steps: what a run leaves is always drawn by it."""
        before = self.stage
        while self.end_stage():
            pass
        if self.stage != before:
            self._adopt()

    def rehearse(self) -> None:
        """Go through one step without taking it, so that whatever is compiled or loaded at first use is there."""
        self._objective(Region(0, 0, *self.size))
        self.zero_grad()

    def on_fit_start(self) -> None:
        self._clock = time.monotonic()

    def training_step(self, batch: Any, batch_idx: int) -> None:
        optimizer = self.optimizers(use_pl_optimizer=False)
        assert isinstance(optimizer, optim.Optimizer)
        end = time.monotonic() + SECONDS_PER_CALL
        while self.step < self.steps and not self.stop:
            self._take_step(optimizer)
            if time.monotonic() > end:
                break
        curves = {f"loss/{name}": term for name, term in self.terms.items()}
        self.log_dict({**curves, "psnr": psnr_of(self.error), "step": float(self.step)})
        now = time.monotonic()
        self.seconds, self._clock = self.seconds + now - self._clock, now

    def configure_optimizers(self) -> optim.Optimizer:
        return self.parts.optimizer.over(p for p in self.catalogue.parameters() if p.requires_grad)

    def on_save_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        frozen = {name for name, parameter in self.named_parameters() if not parameter.requires_grad}
        checkpoint["state_dict"] = {k: v for k, v in checkpoint["state_dict"].items() if k not in frozen}
        checkpoint["painter"] = {
            "step": self.step,
            "ends": self.ends,
            "seconds": self.seconds,
            "generator": self.generator.get_state(),
            "torch": torch.get_rng_state(),
            "accuracy": self._accuracy,
            "front_to_back": self.front_to_back,
        }

    def on_load_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        state = checkpoint["painter"]
        self.step, self.ends, self.seconds = state["step"], state["ends"], state["seconds"]
        self.generator.set_state(state["generator"])
        torch.set_rng_state(state["torch"])
        self._accuracy = state["accuracy"]
        self.front_to_back = state["front_to_back"]

    def _take_step(self, optimizer: optim.Optimizer) -> None:
        if self.step % self.parts.order.every == 0:
            self._renew_order()
        stage, renderer = self.stage, self.renderer
        done, steps = self.progress
        for group in optimizer.param_groups:
            group["lr"] = self.parts.optimizer.rate(done / steps)
        region = self.parts.sampler(self.size, self.step, self.generator)
        judge = self.parts.order.needs_accuracy and (self.step + 1) % self.parts.order.every == 0
        painting: Painting | None = None

        def objective() -> Tensor:
            nonlocal painting
            optimizer.zero_grad(set_to_none=True)
            total, painting = self._objective(region, judge=judge)
            return total

        optimizer.step(objective)  # type: ignore[arg-type]
        self.catalogue.keep_in_range()
        strokes = self.catalogue()
        projected = renderer.project(strokes)
        if projected is not strokes:
            self.catalogue.replace(projected)
        self.step += 1
        assert painting is not None
        revision = self.parts.density.revise(painting, self.step, self.steps)
        if revision is not None:
            self.catalogue.revise(revision.keep, revision.new, optimizer)
            self._accuracy = None
            self._renew_order()
        self.watch(self.step)
        if self.stage != stage:
            self._adopt()
            optimizer.state.clear()

    def _objective(self, region: Region, *, judge: bool = False) -> tuple[Tensor, Painting]:
        """The weighted sum of losses, after its gradient has been computed."""
        with torch.enable_grad():
            canvas, painting = self.paint(region, judge=judge)
            terms = {name: loss(painting) for name, loss in self.losses.items()}
            total = torch.stack([self.parts.losses[name].weight * term for name, term in terms.items()]).sum()
            if total.requires_grad:
                total.backward()
        self.terms = {name: term.detach() for name, term in terms.items()}
        self._last = (painting.image.detach(), painting.target)
        if canvas.accuracy is not None:
            before = torch.zeros_like(canvas.accuracy) if self._accuracy is None else self._accuracy
            self._accuracy = torch.where(canvas.accuracy.isnan(), before, canvas.accuracy)
        return total.detach(), painting

    @torch.no_grad()
    def _adopt(self) -> None:
        """Hand the strokes over to the renderer of the present stage."""
        strokes, stage = self.catalogue(), self.parts.stages[self.stage]
        adopted = stage.renderer.adopt(strokes)
        if adopted is not strokes:
            self.catalogue.replace(adopted)
        changed = _count_changed(strokes, adopted)
        if changed or self.stage:
            log.info(
                "step %d: from here %s draws; %d of %d strokes were changed to fit what it can draw",
                self.step, stage.name, changed, len(strokes),
            )  # fmt: skip
        self._renew_order()

    @torch.no_grad()
    def _renew_order(self) -> None:
        self.front_to_back = front_to_back(self.parts.order.depth(self.catalogue(), self._accuracy))


def _count_changed(before: Strokes, after: Strokes) -> int:
    """Strokes whose curve or thickness differs by more than ``MOVED`` pixels."""
    points = (curve_of(after) - curve_of(before)).abs().flatten(1).amax(1)
    thickness = 2 * (half_width_of(after) - half_width_of(before)).abs()
    return int((torch.maximum(points, thickness) > MOVED).sum())
