"""The optimisation: one gradient step over the strokes after another, as a LightningModule."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from functools import partial
from typing import Any

import lightning as L
import torch
from lightning.pytorch.core.optimizer import LightningOptimizer
from torch import Tensor, nn, optim
from torch.optim.lr_scheduler import LambdaLR

from brushexp.errors import UserError
from brushexp.painting.anytime import Anytime
from brushexp.painting.components import Components
from brushexp.painting.depth import Depth
from brushexp.painting.importance import importance
from brushexp.painting.metrics import psnr_of
from brushexp.painting.partial import partial_update
from brushexp.painting.picture import Picture
from brushexp.painting.schedule import Schedule
from brushexp.pictures.region import Region
from brushexp.plugins.density.base import DensificationState
from brushexp.plugins.loss.base import weighted_sum
from brushexp.plugins.renderer.base import Renderer
from brushexp.plugins.sampler.base import View
from brushexp.strokes.bezier import curve_of, half_width_of
from brushexp.strokes.catalogue import Catalogue, Strokes

log = logging.getLogger(__name__)
LOG_SECONDS = 0.25  # at least between two points of the curves: writing one costs as much as half a step
MOVED_PIXELS = 0.01  # by which a stroke may change without being counted


class Painter(L.LightningModule):
    """Moves strokes until the picture matches the target. Renderers stay frozen.

    The steps go through the stages one after another. When one begins, its renderer converts the strokes, and the
    optimiser and the schedule of its learning rate start afresh. An epoch is the whole plan.

    Args:
        catalogue: the strokes.
        components: how they are drawn, compared and moved.
        target: (3, H, W) in [0, 1].
        background: (3,) colour of the bare canvas.
        seed: of everything random in the steps.
        focus: (H, W) how much each pixel counts in the losses, of mean 1; None for all alike.
        budget: strokes that the density policy may come to; None for as many as there are.
        coarse: share of the first stage's steps that come first and look at the whole picture at half its size;
            strokes are neither added nor removed meanwhile.

    Attributes:
        schedule: steps, stages and seconds.
        stop: why the fit ends before its last step; "" while it goes on.
        terms: the losses of the last step, unweighted.
        evaluations: of the losses so far; an optimiser may need several for a step.
        visits: (N,) steps that each stroke has taken.
        anytime: how good the picture was after how many seconds.

    >>> from brushexp.plugins.init.random import Random
    >>> from brushexp.painting.components import standard_components
    >>> target, components = torch.rand(3, 24, 32), standard_components(steps=3)
    >>> strokes = Random()(target, 20, torch.Generator())
    >>> painter = Painter(Catalogue(strokes, components.optimizer.units), components, target, torch.ones(3), seed=0)
    >>> quiet = {"logger": False, "enable_checkpointing": False, "enable_progress_bar": False}
    >>> trainer = L.Trainer(max_epochs=1, enable_model_summary=False, **quiet)
    >>> trainer.fit(painter)
    >>> trainer.global_step, painter.drawn().shape
    (3, torch.Size([3, 24, 32]))
    """

    visits: Tensor

    def __init__(
        self,
        catalogue: Catalogue,
        components: Components,
        target: Tensor,
        background: Tensor,
        *,
        seed: int,
        focus: Tensor | None = None,
        budget: int | None = None,
        coarse: float = 0.0,
    ) -> None:
        super().__init__()
        self.strict_loading = False  # frozen networks are not in the checkpoint
        self.catalogue = catalogue
        self.components = components
        self.renderers = nn.ModuleList(stage.renderer.requires_grad_(False) for stage in components.stages)
        self.losses = nn.ModuleDict(components.losses)
        if not 0 <= coarse < 1:
            raise UserError(f"coarse={coarse:g} is not a share of the steps from 0 to below 1; try coarse=0.5")
        self.coarse = coarse
        self.budget = len(catalogue) if budget is None else budget
        self.generator = torch.Generator().manual_seed(seed)
        self.schedule = Schedule([stage.steps for stage in components.stages])
        self.picture = Picture(target, focus, background, components.blend)
        self.depth = Depth(components.order)
        self.register_buffer("visits", torch.zeros(len(catalogue), dtype=torch.long), persistent=False)
        self.evaluations = 0
        self.stop = ""
        self.anytime = Anytime()
        self.terms: dict[str, Tensor] = {}
        self._next_log = 0.0
        self._begin_stage()

    @property
    def renderer(self) -> Renderer:
        """That of the present stage."""
        return self.picture.renderer

    @property
    def is_coarse(self) -> bool:
        """Whether the next step looks at the smaller picture."""
        done, steps = self.schedule.stage_progress
        return self.schedule.stage == 0 and done < self.coarse * steps

    @property
    def title(self) -> str:
        """What the progress bar says; each stage has its own: a step of one may take a hundred times as long."""
        stages = self.components.stages
        return f"painting with {stages[self.schedule.stage].name}" if len(stages) > 1 else "painting"

    @property
    def progress(self) -> float:
        """How much of the present stage is done, 0 to 1."""
        done, steps = self.schedule.stage_progress
        return done / max(steps, 1)

    def state_line(self) -> str:
        """Step, loss and quality in a few words."""
        total = sum(self.components.losses[name].weight * float(term) for name, term in self.terms.items())
        quality = f"loss {total:.5f}, {psnr_of(self.picture.error):.2f} dB"
        return f"step {self.schedule.step} of {self.schedule.steps}, {quality}"

    @torch.no_grad()
    def strokes(self) -> Strokes:
        """The strokes now, without gradient."""
        return self.catalogue()

    def drawn(self) -> Tensor:
        """The whole picture (3, H, W) now."""
        return self.picture.draw(self.strokes(), self.depth.front_to_back)

    def latest(self) -> Tensor:
        """The whole picture as the steps last saw it; as it is now before the first one."""
        last = self.picture.last
        return self.drawn() if last is None else last

    def hand_over(self) -> None:
        """Give the strokes to the last renderer, whatever the steps: what a run leaves is always drawn by it."""
        while self.schedule.end_stage():
            pass
        if self._stage != self.schedule.stage:
            self._begin_stage()

    def train_dataloader(self) -> Iterator[int]:
        """Without end: the plan may change, and a fit ends with it."""
        return iter(lambda: 0, 1) if self.schedule.step < self.schedule.steps else iter(())

    def configure_optimizers(self) -> Any:
        optimizer = self.components.optimizer.over(p for p in self.catalogue.parameters() if p.requires_grad)
        scheduler = LambdaLR(optimizer, lambda _: self.components.optimizer.share(self.progress))
        return {"optimizer": optimizer, "lr_scheduler": {"scheduler": scheduler, "interval": "step"}}

    def training_step(self, batch: Any, batch_idx: int) -> Tensor:
        """The weighted sum of the losses of what the step looks at; L-BFGS asks several times in a step."""
        self.evaluations += 1
        self._moving.keep_in_range()  # a line search may look anywhere
        canvas, self._painting = self.picture.see(
            self._moving(), self._still, self._view, self.depth.front_to_back,
            coarse=self.is_coarse, accuracy=self._measure,
        )  # fmt: skip
        self.depth.measured(canvas.accuracy, self._view.active, len(self.catalogue))
        total, terms = weighted_sum(self.components.losses, self._painting)
        self.terms = {name: term.detach() for name, term in terms.items()}
        return total if total.requires_grad else total.requires_grad_()

    def optimizer_step(self, epoch: int, batch_idx: int, optimizer: Any, optimizer_closure: Any = None) -> None:
        """One gradient step: look, move strokes, keep them drawable, and then add and remove some.

        Args:
            epoch: Lightning's.
            batch_idx: Lightning's.
            optimizer: of all strokes.
            optimizer_closure: zeroes gradients, calls `training_step` and goes backward.
        """
        schedule, order, sampler = self.schedule, self.components.order, self.components.sampler
        if schedule.stage != self._stage:
            self._begin_stage(optimizer)
        if order.due(*schedule.stage_progress):
            self.depth.renew(self.strokes())
        coarse, view = self.is_coarse, self._look()
        with partial_update(self.catalogue, inner(optimizer), view.active, self.visits) as self._moving:
            optimizer.step(closure=optimizer_closure)
            self._moving.keep_in_range()
            strokes = self._moving()
            clamped = self.renderer.clamp(strokes)
            if clamped is not strokes:
                self._moving.replace(clamped)
        self.picture.moved(view.active)
        schedule.step += 1
        if not coarse:
            sampler.seen(view, self._painting.image.detach(), self._painting.target)
            self._densify(inner(optimizer))

    def on_fit_start(self) -> None:
        with torch.random.fork_rng(devices=[self.device] if self.device.type == "cuda" else []):
            self._rehearse()
        self.schedule.start()
        self._next_log = 0.0  # the first step of a fit is written, so that its values are known to callbacks
        if not self.anytime.pairs:
            self.anytime.add(0.0, psnr_of(self.picture.error))

    def on_train_batch_end(self, outputs: Any, batch: Any, batch_idx: int) -> None:
        seconds, done = self.schedule.seconds, self.schedule.step >= self.schedule.steps
        every = self.trainer.log_every_n_steps if self._next_log else 1  # type: ignore[attr-defined]
        if done or (seconds >= self._next_log and self.global_step % every == 0):
            self._next_log = seconds + LOG_SECONDS
            psnr = psnr_of(self.picture.error)
            self.anytime.add(seconds, psnr)
            labels = {name: self.components.losses[name].label or name for name in self.terms}
            curves = {f"loss/{labels[name]}": float(term) for name, term in self.terms.items()}
            values = {**curves, "psnr": psnr, "seconds": seconds}
            # Past `log`, which costs half a millisecond at every later step, too, and writes old values again.
            self.trainer.callback_metrics.update({name: torch.tensor(value) for name, value in values.items()})
            for logger in self.loggers:
                logger.log_metrics(values, self.schedule.step)
        if done:
            self.trainer.should_stop = True

    def on_train_end(self) -> None:
        self.schedule.pause()

    def on_save_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        state = checkpoint["state_dict"]
        checkpoint["state_dict"] = {key: value for key, value in state.items() if key.startswith("catalogue.")}
        memory = self.picture.memory
        checkpoint["painter"] = {
            "stage": self._stage,
            "schedule": self.schedule.state_dict(),
            "depth": self.depth.state_dict(),
            "sampler": self.components.sampler.state_dict(),
            "density": self.components.density.state_dict(),
            "evaluations": self.evaluations,
            "visits": self.visits,
            "picture": None if memory is None else memory.picture,
            "anytime": self.anytime.pairs,
            "generator": self.generator.get_state(),
            "torch": torch.get_rng_state(),
        }

    def on_load_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        state, device = checkpoint["painter"], self.picture.target.device
        self._use_stage(state["stage"])
        self.catalogue.resize(len(state["visits"]))
        self.schedule.load_state_dict(state["schedule"])
        self.depth.load_state_dict(state["depth"], device)
        self.components.sampler.load_state_dict(state["sampler"])
        self.components.density.load_state_dict(state["density"])
        self.evaluations, self.visits = state["evaluations"], state["visits"].to(device)
        self.anytime = Anytime(state["anytime"])
        if state["picture"] is not None:
            self.picture.remember(state["picture"].to(device), len(self.catalogue))
        self.generator.set_state(state["generator"])
        torch.set_rng_state(state["torch"])

    def _look(self) -> View:
        """Decide where this step looks, and what it measures there."""
        strokes, size = self.strokes(), self.picture.size
        if self.is_coarse:
            view = View(Region(0, 0, *self.picture.level(coarse=True).size))
        else:
            view = self.components.sampler(strokes, size, self.schedule.step, self.generator)
        self._view, self._still = view, strokes
        self._measure = self.depth.needs_accuracy(self.schedule, partial=view.active is not None)
        return view

    def _rehearse(self) -> None:
        """Go through a step without taking it, so that what is compiled or loaded at first use is there."""
        sampler, memory = self.components.sampler, self.picture.memory
        before = sampler.state_dict(), self.generator.get_state(), self.coarse, self.evaluations
        if memory is not None:
            self.picture.remember(memory.picture.clone(), len(self.catalogue))
        self.coarse = 0.0
        rows = self._look().active
        self._moving, self._measure = self.catalogue if rows is None else self.catalogue.part(rows), False
        with torch.enable_grad():
            self.training_step(None, 0).backward()
        if self.components.density.uses_importance:
            self._densification_state().importance()
        self.zero_grad()
        self.picture.memory = self.picture.memory if memory is None else memory
        state, generator, self.coarse, self.evaluations = before
        sampler.load_state_dict(state)
        self.generator.set_state(generator)

    def _densification_state(self) -> DensificationState:
        """The painting as the density policy sees it."""
        strokes, picture, schedule = self.strokes(), self.picture, self.schedule
        judge = partial(
            importance, strokes, self.depth.front_to_back, picture.target, picture.focus, picture.background,
            self.renderer, picture.blend, self.generator,
        )  # fmt: skip
        size = (self.budget, schedule.step, schedule.steps)
        return DensificationState(self.latest(), picture.target, picture.focus, strokes, *size, judge)

    def _densify(self, optimizer: optim.Optimizer) -> None:
        """Drop strokes and add others, if the density policy asks for it."""
        density, schedule = self.components.density, self.schedule
        if not density.due(schedule.step, schedule.steps):
            return
        update = density.revise(self._densification_state())
        if update is None:
            return
        self.catalogue.revise(update.keep, self.renderer.convert(update.new), optimizer)
        # New strokes count as often moved as the oldest: the optimiser counts their steps together.
        new = self.visits.new_full((len(update.new),), int(self.visits.max()) if len(self.visits) else 0)
        self.visits = torch.cat([self.visits[update.keep], new])
        self.depth.accuracy = None
        self.picture.forget()
        self.depth.renew(self.strokes())

    def _use_stage(self, stage: int) -> None:
        self._stage = stage
        self.picture.forget()
        self.picture.renderer = self.components.stages[stage].renderer

    @torch.no_grad()
    def _begin_stage(self, optimizer: Any = None) -> None:
        """Hand the strokes over to the renderer of the present stage, and let the optimiser start afresh."""
        strokes, stage = self.strokes(), self.schedule.stage
        self._use_stage(stage)
        converted = self.renderer.convert(strokes)
        if converted is not strokes:
            self.catalogue.replace(converted)
        changed = n_changed(strokes, converted)
        if changed or stage:
            log.info(
                "step %d: switching to renderer %s; %d of %d strokes were converted to what it can draw",
                self.schedule.step, self.components.stages[stage].name, changed, len(strokes),
            )  # fmt: skip
        self.depth.renew(converted)
        if optimizer is not None:
            inner(optimizer).state.clear()
            self.visits.zero_()
            for group in optimizer.param_groups:
                group["lr"] = group["initial_lr"] * self.components.optimizer.share(0.0)


def inner(optimizer: Any) -> optim.Optimizer:
    """PyTorch's optimiser below the one that Lightning passes."""
    return optimizer.optimizer if isinstance(optimizer, LightningOptimizer) else optimizer


def n_changed(before: Strokes, after: Strokes) -> int:
    """Strokes whose curve or thickness differs by more than ``MOVED_PIXELS``."""
    points = (curve_of(after) - curve_of(before)).abs().flatten(1).amax(1)
    thickness = 2 * (half_width_of(after) - half_width_of(before)).abs()
    return int((torch.maximum(points, thickness) > MOVED_PIXELS).sum())
