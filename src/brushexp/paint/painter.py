"""The optimisation: gradient steps over the catalogue, as a LightningModule."""

import logging
import math
import time
from collections.abc import Callable
from itertools import accumulate
from typing import Any

import lightning as L
import torch
from torch import Tensor, nn, optim

from brushexp.blend.base import Canvas
from brushexp.loss.base import Painting
from brushexp.order.base import front_to_back
from brushexp.paint.bands import bands
from brushexp.paint.metrics import psnr_of
from brushexp.paint.partial import lend, take_back
from brushexp.paint.parts import Parts
from brushexp.paint.view import View
from brushexp.renderer.base import Renderer
from brushexp.sampler.base import Glance
from brushexp.strokes.bezier import curve_of, half_width_of
from brushexp.strokes.catalogue import Catalogue, Strokes

log = logging.getLogger(__name__)
SECONDS_PER_CALL = 0.2  # one training step of Lightning takes as many gradient steps as fit, so that its own cost hides
MOVED = 0.01  # pixels by which a stroke may change without being counted


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
    front_to_back: Tensor
    visits: Tensor

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
        self.evaluations = 0  # of the losses so far; an optimiser may need several for a step
        # Partial steps that each stroke has taken.
        self.register_buffer("visits", torch.zeros(len(catalogue), dtype=torch.long), persistent=False)
        self.register_buffer("front_to_back", torch.arange(len(catalogue)), persistent=False)
        self.stop = ""  # set from outside: finish after the present step, for this reason
        self.seconds = 0.0  # of wall time in the fit so far
        self.terms: dict[str, Tensor] = {}  # the losses of the last step, unweighted
        self._last: Tensor | None = None  # the whole picture, if the last step looked at all of it
        self._view: View | None = None  # of a painter who looks at parts
        self._error = math.inf  # before there was one, or of the last one
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
        """Mean squared error of the whole picture as it was last seen."""
        if self._view is not None:
            return self._view.error
        return self._error if self._last is None else float((self._last - self.target).square().mean())

    @torch.no_grad()
    def picture(self) -> Tensor:
        """The whole picture (3, H, W) now."""
        image = torch.empty_like(self.target)
        strokes = self.catalogue()
        for top, band in bands(
            strokes, self.front_to_back, self.size, self.background, self.renderer, self.parts.blend
        ):
            image[:, top : top + band.shape[1]] = band
        return image

    def latest(self) -> Tensor:
        """The whole picture as the steps last saw it; as it is now before the first one."""
        if self._view is not None:
            return self._view.picture
        return self.picture() if self._last is None else self._last

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
        sampler = self.parts.sampler
        before, generator = sampler.state_dict(), self.generator.clone_state()
        glance = sampler(self._strokes(), self.size, self.step, generator)
        sampler.load_state_dict(before)
        self._objective(self.catalogue if glance.active is None else self.catalogue.part(glance.active), glance)
        self.zero_grad()
        self.evaluations = 0

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
        now = time.monotonic()
        self.seconds, self._clock = self.seconds + now - self._clock, now
        curves = {f"loss/{self.parts.losses[name].label or name}": term for name, term in self.terms.items()}
        self.log_dict({**curves, "psnr": psnr_of(self.error), "step": float(self.step), "seconds": self.seconds})

    def configure_optimizers(self) -> optim.Optimizer:
        return self.parts.optimizer.over(p for p in self.catalogue.parameters() if p.requires_grad)

    def on_save_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        frozen = {name for name, parameter in self.named_parameters() if not parameter.requires_grad}
        checkpoint["state_dict"] = {k: v for k, v in checkpoint["state_dict"].items() if k not in frozen}
        checkpoint["painter"] = {
            "step": self.step,
            "evaluations": self.evaluations,
            "visits": self.visits,
            "sampler": self.parts.sampler.state_dict(),
            "picture": None if self._view is None else self._view.picture,
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
        self.evaluations, self.visits = state["evaluations"], state["visits"].to(self.target.device)
        self.parts.sampler.load_state_dict(state["sampler"])
        self.generator.set_state(state["generator"])
        torch.set_rng_state(state["torch"])
        device = self.target.device
        self.front_to_back = state["front_to_back"].to(device)
        self._accuracy = None if state["accuracy"] is None else state["accuracy"].to(device)
        self._view = None if state["picture"] is None else self._view_of(state["picture"].to(device))

    def _take_step(self, optimizer: optim.Optimizer) -> None:
        if self.step % self.parts.order.every == 0:
            self._renew_order()
        stage = self.stage
        done, steps = self.progress
        for group in optimizer.param_groups:
            group["lr"] = self.parts.optimizer.rate(done / steps)
        glance = self.parts.sampler(self._strokes(), self.size, self.step, self.generator)
        judge = self.parts.order.needs_accuracy and (
            glance.active is not None or (self.step + 1) % self.parts.order.every == 0
        )
        painting = self._move(optimizer, glance, judge)
        self.step += 1
        revision = self.parts.density.revise(painting, self.step, self.steps)
        if revision is not None:
            self.catalogue.revise(revision.keep, revision.new, optimizer)
            self.visits = torch.cat([self.visits[revision.keep], self.visits.new_zeros(len(revision.new))])
            self._accuracy = None
            self._drop_view()
            self._renew_order()
        self.watch(self.step)
        if self.stage != stage:
            self._adopt()
            optimizer.state.clear()
            self.visits.zero_()

    def _move(self, optimizer: optim.Optimizer, glance: Glance, judge: bool) -> Painting:
        """Let the optimiser move the strokes of a glance; what it looked at last."""
        rows = glance.active
        part, mover = self.catalogue, optimizer
        if rows is not None:
            part, mover = lend(self.catalogue, optimizer, self.parts.optimizer, rows, int(self.visits[rows].min()))
        painting: Painting | None = None

        def objective() -> Tensor:
            nonlocal painting
            mover.zero_grad(set_to_none=True)
            part.keep_in_range()  # a line search may look anywhere
            total, painting = self._objective(part, glance, judge=judge)
            return total

        mover.step(objective)  # type: ignore[arg-type]
        part.keep_in_range()
        strokes = part()
        projected = self.renderer.project(strokes)
        if projected is not strokes:
            part.replace(projected)
        if rows is not None:
            if not take_back(self.catalogue, optimizer, part, mover, rows) and not self.step:
                log.info("%s cannot remember single strokes: each step begins afresh", type(mover).__name__)
            self.visits[rows] += 1
            if self._view is not None:
                self._view.kept.forget(rows)
        assert painting is not None
        return painting

    def _objective(self, part: Catalogue, glance: Glance, *, judge: bool = False) -> tuple[Tensor, Painting]:
        """The weighted sum of losses, after its gradient in the strokes of ``part`` has been computed."""
        self.evaluations += 1
        with torch.enable_grad():
            canvas, painting = self._paint(part(), glance, judge=judge)
            terms = {name: loss(painting) for name, loss in self.losses.items()}
            # A mean over a part of the pixels counts by its share of them, so that the sum stays balanced.
            shares = {name: painting.share if loss.over_pixels else 1 for name, loss in self.parts.losses.items()}
            weighted = [self.parts.losses[name].weight * shares[name] * term for name, term in terms.items()]
            total = torch.stack(weighted).sum()
            if total.requires_grad:
                total.backward()
        self.terms = {name: term.detach() for name, term in terms.items()}
        if canvas.accuracy is not None:
            self._judge(canvas.accuracy, glance.active)
        return total.detach(), painting

    def _paint(self, strokes: Strokes, glance: Glance, *, judge: bool) -> tuple[Canvas, Painting]:
        """What a glance shows, differentiable in ``strokes``: those that it moves."""
        if glance.active is None:
            target = self.target if judge else None
            layers = self.renderer(strokes)
            canvas = self.parts.blend(layers, self.front_to_back, self.size, self.background, target)
            self._last = canvas.image.detach()
            return canvas, Painting(canvas.image, self.target, strokes)
        if self._view is None:
            self._view = self._view_of(self.picture())
        return self._view.paint(strokes, self._strokes(), glance, self.front_to_back, judge=judge)

    def _drop_view(self) -> None:
        """The strokes are others now, or drawn by another renderer."""
        if self._view is not None:
            self._error, self._view = self._view.error, None

    def _view_of(self, picture: Tensor) -> View:
        return View(picture, self.target, self.background, self.renderer, self.parts.blend, len(self.catalogue))

    @torch.no_grad()
    def _strokes(self) -> Strokes:
        """The strokes now, without gradient."""
        return self.catalogue()

    def _judge(self, accuracy: Tensor, rows: Tensor | None) -> None:
        """Take over the accuracy of strokes number ``rows``; NaN says nothing."""
        if self._accuracy is None:
            self._accuracy = accuracy.new_zeros(len(self.catalogue))
        seen = slice(None) if rows is None else rows
        self._accuracy[seen] = torch.where(accuracy.isnan(), self._accuracy[seen], accuracy)

    @torch.no_grad()
    def _adopt(self) -> None:
        """Hand the strokes over to the renderer of the present stage."""
        strokes, stage = self.catalogue(), self.parts.stages[self.stage]
        adopted = stage.renderer.adopt(strokes)
        if adopted is not strokes:
            self.catalogue.replace(adopted)
        self._drop_view()
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
