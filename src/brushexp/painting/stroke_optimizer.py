"""Optimise strokes by gradient steps, as a LightningModule."""

import logging
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from copy import deepcopy
from typing import Any

import torch
from torch import Tensor, optim
from torch.optim.lr_scheduler import LambdaLR

from brushexp.painting.components import Components
from brushexp.painting.densification import importance
from brushexp.painting.divergence import first_broken
from brushexp.painting.painting_module import Epoch, PaintingModule
from brushexp.painting.partial import STEP_COUNT, partial_update, unwrap_optimizer
from brushexp.painting.picture import Picture
from brushexp.painting.schedule import Schedule
from brushexp.painting.variety import break_colors
from brushexp.pictures.region import Region
from brushexp.plugins.density.base import DensificationState
from brushexp.plugins.loss.base import restore, state_of, weighted_sum
from brushexp.plugins.sampler.base import View
from brushexp.strokes.bezier import curve_of, half_width_of
from brushexp.strokes.catalogue import Catalogue, Strokes, check_strokes
from brushexp.system.callbacks import DIVERGED

log = logging.getLogger(__name__)
CHANGE_PIXELS = 0.01  # largest change of a stroke by a renderer that the log does not count


class StrokeOptimizer(PaintingModule):
    """Moves strokes until the picture matches the target. A batch is a `View`; renderers stay frozen.

    When a stage begins, its renderer converts the strokes, and the optimiser and its learning rate start afresh. The
    first steps, the share ``coarse`` of the first stage, look at the whole picture at half its size; meanwhile no
    strokes come or go.

    >>> import lightning as L
    >>> from brushexp.plugins.init.random import Random
    >>> from brushexp.painting.components import standard_components
    >>> target, components = torch.rand(3, 24, 32), standard_components(steps=3)
    >>> strokes = Random()(target, 20, torch.Generator())
    >>> catalogue = Catalogue(strokes, components.optimizer.units)
    >>> painter = StrokeOptimizer(catalogue, components, target, torch.ones(3), seed=0)
    >>> quiet = {"logger": False, "enable_checkpointing": False, "enable_progress_bar": False}
    >>> trainer = L.Trainer(max_steps=3, enable_model_summary=False, **quiet)
    >>> trainer.fit(painter)
    >>> trainer.global_step, painter.draw_whole().shape
    (3, torch.Size([3, 24, 32]))

    The same without a Trainer, by an optimiser of one's own:

    >>> optimizer = torch.optim.Adam(painter.catalogue.parameters(), lr=0.02)
    >>> for i, view in zip(range(3), painter.train_dataloader()):
    ...     optimizer.zero_grad()
    ...     painter.training_step(view, i).backward()
    ...     optimizer.step()
    """

    resumable = True
    visits: Tensor  # (N,) steps that each stroke has taken
    stage: int  # number of the one whose renderer draws the strokes

    def __init__(
        self,
        catalogue: Catalogue,
        components: Components,
        target: Tensor,  # (3, H, W) in [0, 1]
        background: Tensor,  # (3,) colour of the bare canvas
        *,
        seed: int,  # it decides everything random in the steps
        focus: Tensor | None = None,  # (H, W) how much each pixel counts in the losses, of mean 1; None for all alike
        budget: int | None = None,  # strokes that the density policy may come to; None for as many as there are
        coarse: float = 0.0,
        variety: float = 0.0,  # how far colours of finished strokes are broken, 0 to 1
    ) -> None:
        schedule = Schedule([stage.steps for stage in components.stages])
        super().__init__(components, Picture(target, focus, background, components.blend), schedule)
        self.strict_loading = False  # frozen networks are not in the checkpoint
        self.catalogue = self.moving = catalogue  # moving is what a step changes: all, or some as a catalogue of theirs
        self.coarse, self.variety = coarse, variety
        self.limit: Callable[[Strokes, Strokes | None, Tensor | None], Strokes] = lambda strokes, before, rows: strokes
        self.generator, self.budget = torch.Generator().manual_seed(seed), budget or len(catalogue)
        self.register_buffer("visits", torch.zeros(len(catalogue), dtype=torch.long), persistent=False)
        self._view, self._evaluations_before = View(Region.whole(target)), 0  # of this step
        self._begin_stage()

    @property
    def is_coarse(self) -> bool:
        done, steps = self.schedule.stage_progress
        return done < self.coarse * steps and self.schedule.stage == 0

    @property
    def is_unready(self) -> bool:
        return self.is_coarse or len(self.catalogue) > self.budget

    @property
    def title(self) -> str:
        """Label of the progress bar, for each stage."""
        stages = self.components.stages
        return f"painting with {stages[self.schedule.stage].name}" if len(stages) > 1 else "painting"

    @torch.no_grad()
    def strokes(self) -> Strokes:
        return self.limit(self.catalogue(), None, None)

    def train_dataloader(self) -> Epoch:
        return Epoch(self._views())

    def _views(self) -> Iterator[View]:
        while True:
            if self.schedule.stage != self.stage:
                self._begin_stage()
            yield View(Region.whole(self.picture.target), coarse=True) if self.is_coarse else self._sample()

    def _sample(self) -> View:
        return self.components.sampler(self.strokes(), self.picture.size, self.schedule.step, self.generator)

    def configure_optimizers(self) -> Any:
        optimizer = self.components.optimizer.over(p for p in self.catalogue.parameters() if p.requires_grad)
        scheduler = LambdaLR(optimizer, lambda _: self.components.optimizer.share(self.progress))
        return {"optimizer": optimizer, "lr_scheduler": {"scheduler": scheduler, "interval": "step"}}

    def on_train_batch_start(self, view: View, batch_idx: int) -> None:
        self._view, self._evaluations_before = view, self.evaluations
        if self.components.order.due(*self.schedule.stage_progress):
            self.depth.renew(self.strokes())

    def training_step(self, view: View, batch_idx: int) -> Tensor:
        """Paint what the view shows and compare it with the target; L-BFGS does so several times in a step."""
        if self.evaluations > self._evaluations_before:  # a line search may have moved the strokes anywhere
            self.moving.keep_in_range()
        self.evaluations += 1
        accuracy = self.depth.needs_accuracy(self.schedule, partial=view.active is not None)
        is_cut_out = view.active is None or self.moving is not self.catalogue
        moving = self.moving() if is_cut_out else self.catalogue()[view.active]
        strokes = moving if view.active is None else self.strokes()
        canvas, painting = self.picture.see(moving, strokes, view, self.front_to_back, accuracy=accuracy)
        self.depth.note_accuracy(canvas.accuracy, view.active, len(self.catalogue))
        loss, terms = weighted_sum(self.components.losses, painting)
        self.terms = {name: term.detach() for name, term in terms.items()}
        return loss if loss.requires_grad else loss.requires_grad_()

    def optimizer_step(self, epoch: int, batch_idx: int, optimizer: Any, optimizer_closure: Any = None) -> None:
        """Move the strokes of the view, keep them drawable, and then add and remove some."""
        rows, plain_optimizer = self._view.active, unwrap_optimizer(optimizer)
        if self.schedule.stage and not self.schedule.stage_progress[0]:
            self._restart(plain_optimizer)
        with partial_update(self.catalogue, plain_optimizer, rows, self.visits) as self.moving:
            with self._only_finite() as before:
                super().optimizer_step(epoch, batch_idx, optimizer, optimizer_closure)
            self.moving.keep_in_range()
            strokes = self.moving()
            drawable = self.limit(self.renderer.clamp(strokes), before, rows)
            if drawable is not strokes:
                self.moving.replace(drawable)
        self.moving = self.catalogue
        self.picture.forget_strokes(rows)
        self.schedule.step += 1
        self.publish()
        self._densify(plain_optimizer)

    def _densify(self, optimizer: optim.Optimizer) -> None:
        """Let the density policy add and remove strokes."""
        picture, schedule = self.picture, self.schedule
        if self._view.coarse or not self.components.density.due(schedule.step, schedule.steps):
            return
        seen = (self.latest(), picture.target, picture.focus, self.strokes())
        state = DensificationState(*seen, self.budget, schedule.step, schedule.steps, self._judged)
        if (update := self.components.density.revise(state)) is not None:
            self._revise(update.keep, update.new, optimizer)

    def _judged(self) -> Tensor:
        """Measure how important each stroke is (N,)."""
        return importance(self.strokes(), self.front_to_back, self.picture, self.generator)

    def _revise(self, keep: Tensor, new: Strokes, optimizer: optim.Optimizer | None = None) -> None:
        self.catalogue.revise(keep, self.renderer.convert(new), optimizer)
        self.depth.revise(keep, len(new))
        self.picture.forget()
        # New strokes count as often moved as the oldest: the optimiser counts their steps together.
        visits = self.visits.new_full((len(new),), int(self.visits.max()) if len(self.visits) else 0)
        self.visits = torch.cat([self.visits[keep], visits])

    @contextmanager
    def _only_finite(self) -> Iterator[Strokes]:
        """Undo a step that left strokes that are not finite, or a failed loss, and end the fit; yield those before."""
        with torch.no_grad():
            before = self.moving()
        is_finite = False
        try:
            yield before
            finite = torch.stack([term.isfinite() for term in self.terms.values()]).tolist() if self.terms else []
            broken = next((name for name, fine in zip(self.terms, finite, strict=True) if not fine), None)
            is_finite = broken is None and self.moving.is_finite()
            if not is_finite:
                what = first_broken(self, before, broken)
                self.stop, self.trouble = DIVERGED, f"step {self.schedule.step + 1}: {what}"
        finally:
            if not is_finite:
                self.moving.replace(before)

    def prepare(self) -> None:
        """Evaluate the losses once, with gradient, and restore the state: the clock must not count compilation."""
        check_strokes(self.strokes())  # a checkpoint may have given them
        state = deepcopy(self.state())
        self.training_step(self._sample(), 0).backward()
        if self.components.density.uses_importance:
            one = self.strokes()[:1]  # enough to compile it
            importance(one, torch.arange(len(one), device=self.device), self.picture, self.generator)
        self.zero_grad()
        self.load_state(state)

    def hand_over(self) -> None:
        """Hand the strokes, no more than were asked for, to the last renderer, and break their colours."""
        while self.schedule.end_stage():
            pass
        if self.stage != self.schedule.stage:
            self._begin_stage()
        if (surplus := len(self.catalogue) - self.budget) > 0:  # the run ended before its density policy took it away
            ranks = self._judged().argsort(stable=True).argsort()
            self._revise(ranks >= surplus, Strokes.none(self.catalogue.scale))
        break_colors(self.catalogue, self.strokes(), self.picture, self.variety, self.generator)

    def state(self) -> dict[str, Any]:
        """Return what steps depend on beside the strokes and the optimiser, as plain data."""
        return {
            "stage": self.stage,
            "schedule": self.schedule.state_dict(),
            "depth": self.depth.state_dict(),
            "sampler": self.components.sampler.state_dict(),
            "density": self.components.density.state_dict(),
            "losses": state_of(self.components.losses),
            "evaluations": self.evaluations,
            "visits": self.visits,
            "picture": None if self.picture.memory is None else self.picture.memory.picture,
            "anytime": self.anytime,
            "generator": self.generator.get_state(),
            "torch": torch.get_rng_state(),
        }

    def load_state(self, state: dict[str, Any]) -> None:
        """Take over what `state` gave; the strokes follow, into a catalogue that now has their number."""
        device = self.picture.target.device
        self._use_stage(state["stage"])
        self.catalogue.resize(len(state["visits"]))
        self.schedule.load_state_dict(state["schedule"])
        self.depth.load_state_dict(state["depth"], device)
        self.components.sampler.load_state_dict(state["sampler"])
        self.components.density.load_state_dict(state["density"])
        restore(self.components.losses, state["losses"])
        self.evaluations = self._evaluations_before = state["evaluations"]
        self.visits = state["visits"].to(device)
        self.anytime = [(float(seconds), float(psnr)) for seconds, psnr in state["anytime"]]
        if state["picture"] is not None:
            self.picture.memory = self.picture.memory_of(state["picture"].to(device))
        self.generator.set_state(state["generator"])
        torch.set_rng_state(state["torch"])

    def on_save_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        weights = {k: v for k, v in checkpoint["state_dict"].items() if k.startswith("catalogue.")}
        checkpoint |= {"state_dict": weights, "painter": self.state()}

    def on_load_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        self.load_state(checkpoint["painter"])

    def _use_stage(self, stage: int) -> None:
        self.stage = stage
        self.picture.forget()
        self.picture.renderer = self.components.stages[stage].renderer

    @torch.no_grad()
    def _begin_stage(self) -> None:
        self._use_stage(self.schedule.stage)
        self._convert()
        self.depth.renew(self.strokes())

    def _restart(self, optimizer: optim.Optimizer) -> None:
        optimizer.state.clear()
        self.visits.zero_()
        for group in optimizer.param_groups:
            group["lr"] = group["initial_lr"] * self.components.optimizer.share(0.0)
            if STEP_COUNT in group:  # where pytorch_optimizer counts
                group[STEP_COUNT] = 0

    def _convert(self) -> None:
        strokes, stage = self.strokes(), self.stage
        converted = self.renderer.convert(strokes)
        if converted is not strokes:
            self.catalogue.replace(converted)
        points = (curve_of(converted) - curve_of(strokes)).abs().flatten(1).amax(1)
        thickness = 2 * (half_width_of(converted) - half_width_of(strokes)).abs()
        changed = int((torch.maximum(points, thickness) > CHANGE_PIXELS).sum())
        if changed or stage:
            log.info(
                "step %d: switching to renderer %s; %d of %d strokes were converted to what it can draw",
                self.schedule.step, self.components.stages[stage].name, changed, len(strokes),
            )  # fmt: skip
