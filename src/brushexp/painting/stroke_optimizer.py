"""Optimise strokes by gradient steps in a LightningModule."""

import logging
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from copy import deepcopy
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import torch
from torch import Tensor, optim
from torch.optim.lr_scheduler import LambdaLR

from brushexp.painting.components import Components
from brushexp.painting.densification import importance
from brushexp.painting.divergence import find_non_finite
from brushexp.painting.gradient_check import check_dependence, check_slope
from brushexp.painting.painting_module import PaintingModule
from brushexp.painting.partial import STEP_COUNT, partial_update, unwrap_optimizer
from brushexp.painting.picture import Picture
from brushexp.painting.schedule import Schedule
from brushexp.pictures.region import Region
from brushexp.plugins.change.base import Change
from brushexp.plugins.density.base import DensificationState
from brushexp.plugins.loss.base import restore, state_of, weighted_sum
from brushexp.plugins.sampler.base import View
from brushexp.strokes.bezier import curve_of, half_width_of
from brushexp.strokes.catalogue import Catalogue, Strokes, check_strokes
from brushexp.system.earlier import todays_loops
from brushexp.system.status import Status

log = logging.getLogger(__name__)
SHAPE = ("start", "control", "end", "width")  # fields that losses of strokes alone depend on
COARSE_ZOOM = 0.5  # size of the picture of coarse steps relative to the canvas
CHANGE_PIXELS = 0.01  # largest change by a renderer that is not logged


@dataclass(frozen=True)
class GradientClip:
    """Gradient clipping before a step: by ``norm``, or element by element by ``value``."""

    most: float
    algorithm: str = "norm"


class StrokeOptimizer(PaintingModule):
    """Optimises strokes step by step (`take_step`) so that the picture matches the target; renderers stay frozen.

    When a stage begins, its renderer converts the strokes, and the optimiser and its learning rate are reset. The first
    steps, a fraction ``coarse`` of the first stage, compare the whole picture at half its size, without adding or
    removing strokes. A density policy may also choose a smaller picture (`Density.zoom`), on which it may add and
    remove strokes.

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

    To use only the losses, write your own loop with your own optimiser:

    >>> optimizer = torch.optim.Adam(painter.catalogue.parameters(), lr=0.02)
    >>> for _ in range(3):
    ...     optimizer.zero_grad()
    ...     painter.loss(painter.sample()).backward()
    ...     optimizer.step()
    """

    resumable = True
    features: Tensor | None  # (H, W) bool
    visits: Tensor  # (N,) steps taken by each stroke
    stage: int  # index of the stage whose renderer draws the strokes

    def __init__(
        self,
        catalogue: Catalogue,
        components: Components,
        target: Tensor,  # (3, H, W) in [0, 1]
        background: Tensor,  # (3,) colour of the bare canvas
        *,
        seed: int,  # seed of all randomness in the steps
        focus: Tensor | None = None,  # (H, W) weights of the pixels in the losses, of mean 1; None for equal weights
        features: Tensor | None = None,  # (H, W) bool: eyes and mouths, whose small strokes stay; None for nowhere
        budget: int | None = None,  # final number of strokes for the density policy; None for the current number
        psnr: float | None = None,  # PSNR in dB at which a density policy that chooses the number of strokes aims
        is_timed: bool = False,  # whether a time limit decides the number of steps
        coarse: float = 0.0,
        clip: GradientClip | None = None,
        changes: Mapping[str, Change] = MappingProxyType({}),
        painted: tuple[int, int] | None = None,  # height and width of the painting; None for the size of the target
        is_untouched: bool = False,  # whether the strokes come from a catalogue and no step moves them
    ) -> None:
        picture, schedule = (
            Picture(target, focus, background, components.blend),
            Schedule([stage.steps for stage in components.stages]),
        )
        super().__init__(components, picture, schedule, seed=seed, changes=changes)
        self.strict_loading = False  # frozen networks are not in the checkpoint
        self.catalogue, self.budget = catalogue, budget or len(catalogue)
        self.coarse, self.clip, self.painted, self.is_untouched = coarse, clip, painted, is_untouched
        self.wanted_psnr, self.is_timed = psnr, is_timed
        self.is_handed_over = False  # whether no further step follows
        self.register_buffer("features", features, persistent=False)
        self.register_buffer("visits", torch.zeros(len(catalogue), dtype=torch.long), persistent=False)
        self._use_stage(schedule.stage)
        self._begin_changes()
        self._begin_stage()

    @property
    def is_coarse(self) -> bool:
        done, steps = self.schedule.stage_progress
        return done < self.coarse * steps and self.schedule.stage == 0

    @property
    def is_unready(self) -> bool:
        return self.zoom_of_step < 1 or len(self.catalogue) > self.budget

    @property
    def zoom_of_step(self) -> float:
        """Size of the picture in the next step, relative to the canvas."""
        if self.is_coarse:
            return COARSE_ZOOM
        if self.stage:
            return 1.0
        return self.components.density.zoom(len(self.catalogue), self.picture.size, self.wanted_psnr)

    @property
    def title(self) -> str:
        """Label of the progress bar; if there are several stages, it names the renderer of the current one."""
        stages = self.components.stages
        return f"painting with {stages[self.schedule.stage].name}" if len(stages) > 1 else "painting"

    @torch.no_grad()
    def strokes(self) -> Strokes:
        return self.within_limits(self.catalogue())

    @torch.no_grad()
    def within_limits(self, strokes: Strokes, before: Strokes | None = None, rows: Tensor | None = None) -> Strokes:
        """Bring all strokes, or only ``rows``, within the limits of all changes; ``before`` holds their old values."""
        state = self.now(is_over=self.is_handed_over or self.stop is not None)
        for change in self.changes.values():
            strokes = change.limit(strokes, before, rows, state)
        return strokes

    def configure_optimizers(self) -> Any:
        optimizer = self.components.optimizer.over(p for p in self.catalogue.parameters() if p.requires_grad)
        scheduler = LambdaLR(optimizer, lambda _: self.components.optimizer.share(self.progress))
        return {"optimizer": optimizer, "lr_scheduler": scheduler}

    def training_step(self, batch: int, batch_idx: int) -> None:
        """Take a step with the Trainer's optimiser, learning rate schedule, precision and counters."""
        optimizer: Any = self.optimizers()
        schedule: Any = self.lr_schedulers()
        self.take_step(optimizer, self.manual_backward)
        schedule.step()
        self.publish()

    def on_before_optimizer_step(self, optimizer: optim.Optimizer) -> None:
        if self.clip is not None:
            self.clip_gradients(optimizer, self.clip.most, self.clip.algorithm)

    def take_step(self, optimizer: optim.Optimizer, backward: Callable[[Tensor], None] = Tensor.backward) -> None:
        """Take a gradient step: sample a view, render, compare, backpropagate, update, clamp, densify.

        The ``optimizer`` from `configure_optimizers` may evaluate the losses several times, as L-BFGS does. A step that
        makes strokes or a loss non-finite is undone and recorded in `stop` and `trouble`; a step that raises an error
        is also undone.
        """
        plain_optimizer = unwrap_optimizer(optimizer)
        if self.schedule.stage != self.stage:
            self._begin_stage()
            self._restart(plain_optimizer)
        view, is_coarse = self.sample(), self.is_coarse
        self._aim(view)
        if self.components.order.due(*self.schedule.stage_progress):
            self.depth.renew(self.strokes())

        with partial_update(self.catalogue, plain_optimizer, view.active, self.visits) as moving:
            evaluations = self.evaluations

            @torch.enable_grad()
            def closure() -> Tensor:
                if self.evaluations > evaluations:  # a line search may have moved the strokes anywhere
                    moving.keep_in_range()
                loss = self.loss(view, moving())
                plain_optimizer.zero_grad()
                backward(loss)
                return loss.detach()

            with rollback_on_error(moving) as before:
                optimizer.step(closure)  # type: ignore[arg-type]  # they take tensors, too
                trouble = self._find_trouble(moving, before)
            if trouble:
                moving.replace(before)
                self.stop, self.trouble = Status.DIVERGED, f"step {self.schedule.step + 1}: {trouble}"

            moving.keep_in_range()
            strokes = moving()
            drawable = self.within_limits(self._as_renderer_needs(strokes, before), before, view.active)
            if drawable is not strokes:
                moving.replace(drawable)

        self.picture.forget_strokes(view.active)
        self.schedule.step += 1
        if not is_coarse and self.components.density.due(self.schedule.step, self.schedule.steps):
            self._densify(plain_optimizer, view.zoom)
        self.picture.aim(self.picture.target, self.picture.own_background)  # the ground of the displayed picture

    def _as_renderer_needs(self, strokes: Strokes, before: Strokes) -> Strokes:
        """Clamp strokes to those that the renderer can draw, and restore those that it holds from ``before``."""
        clamped, held = self.renderer.clamp(strokes), self.renderer.held(before)
        return clamped if held is None else clamped.with_rows(held, before[held])

    def _aim(self, view: View) -> None:
        """Set the target and the ground for a step as the changes request."""
        target, ground = self.picture.own_target, self.picture.own_background
        state = self.now(is_whole=view.active is None, is_coarse=view.zoom < 1)
        for change in self.changes.values():
            target, ground = change.aim(target, ground, state)
        self.picture.aim(target, ground)

    def sample(self) -> View:
        """Choose which strokes the next step moves, and which view it compares with the target."""
        zoom = self.zoom_of_step
        return View(Region.whole(self.picture.target), zoom=zoom) if zoom < 1 else self._sample_at_full_size()

    def _sample_at_full_size(self) -> View:
        return self.components.sampler(self.strokes(), self.picture.size, self.schedule.step, self.generator)

    def loss(self, view: View, active: Strokes | None = None) -> Tensor:
        """Paint a view and compare it with the target; return a scalar loss, differentiable in the active strokes.

        Unless ``active`` is given, the active strokes are the view's rows of the catalogue.
        """
        loss, terms = self._evaluate(view, active)
        self.terms = {name: term.detach() for name, term in terms.items()}
        return loss if loss.requires_grad else loss.requires_grad_()  # without strokes, it needs no gradient by itself

    def _evaluate(self, view: View, active: Strokes | None = None) -> tuple[Tensor, dict[str, Tensor]]:
        """Compute the objective and each unweighted loss."""
        self.evaluations += 1
        accuracy = self.depth.needs_accuracy(self.schedule, partial=view.active is not None)
        if active is None:
            active = self.catalogue() if view.active is None else self.catalogue()[view.active]
        strokes = active if view.active is None else self.strokes()
        canvas, painting = self.picture.see(active, strokes, view, self.front_to_back, accuracy=accuracy)
        self.depth.note_accuracy(canvas.accuracy, view.active, len(self.catalogue))
        return weighted_sum(self.components.losses, painting)

    def _find_trouble(self, moving: Catalogue, before: Strokes) -> str:
        """Explain which value became non-finite in a step that began with strokes ``before``; "" if none did."""
        finite = torch.stack([term.isfinite() for term in self.terms.values()]).tolist() if self.terms else []
        broken = next((name for name, fine in zip(self.terms, finite, strict=True) if not fine), None)
        return "" if broken is None and moving.is_finite() else find_non_finite(self, before, broken)

    def _densify(self, optimizer: optim.Optimizer, zoom: float) -> None:
        """Let the density policy add and remove strokes, based on the picture painted by a step."""
        if (update := self.components.density.revise(self._state_for_policy(self.latest(zoom), zoom))) is not None:
            self._revise(update.keep, update.new if zoom == 1 else update.new.moved(zoom=1 / zoom), optimizer)
            if update.steps is not None:
                self.schedule.replan(update.steps)

    def _state_for_policy(self, image: Tensor, zoom: float = 1.0) -> DensificationState:
        """Return the state for a density policy, given ``image``, the picture at ``zoom`` times the canvas size."""
        picture, schedule = self.picture.at(zoom), self.schedule
        return DensificationState(
            image=image,
            target=picture.target,
            focus=picture.focus,
            features=self.features if zoom == 1 else None,  # policies that heed them look at the whole canvas
            strokes=self.strokes().moved(zoom=zoom),
            budget=self.budget,
            step=schedule.step,
            steps=schedule.steps,
            importance=lambda: self._measure_importance(zoom),
            psnr=self.wanted_psnr,
            may_replan=not self.is_timed,
            front_to_back=self.front_to_back,
            zoom=zoom,
        )

    def _measure_importance(self, zoom: float = 1.0) -> Tensor:
        """Measure the importance (N,) of each stroke in the picture at ``zoom`` times its size."""
        strokes = self.strokes().moved(zoom=zoom)
        return importance(strokes, self.front_to_back, self.picture.at(zoom), self.generator)

    def _revise(self, keep: Tensor, new: Strokes, optimizer: optim.Optimizer | None = None) -> None:
        self.catalogue.revise(keep, self.renderer.convert(new), optimizer)
        self.depth.revise(keep, len(new))
        self.picture.forget()
        # New strokes count as moved as often as the oldest stroke, because the optimiser counts the steps of all
        # together.
        visits = self.visits.new_full((len(new),), int(self.visits.max()) if len(self.visits) else 0)
        self.visits = torch.cat([self.visits[keep], visits])

    def prepare(self) -> None:
        """Evaluate the losses once, with gradients, so that compilation is not timed; then restore the state.

        Logs losses whose gradient does not reach any stroke, and raises a UserError if this is true of all losses.
        """
        check_strokes(self.strokes())  # a checkpoint may have restored them
        state, losses = deepcopy(self.state()), self.components.losses
        view = self._sample_at_full_size()
        loss, terms = self._evaluate(view)
        moving = [*self.catalogue.parameters()] if view.active is None or len(view.active) else []
        if any(len(parameter) for parameter in moving):
            check_dependence(losses, terms, shapes_move=all(map(self.catalogue.units.get, SHAPE)))
        if loss.requires_grad:
            loss.backward()
            check_slope(losses, loss, moving)
        if self.components.density.uses_importance:
            one = self.strokes()[:1]  # enough to compile the code
            importance(one, torch.arange(len(one), device=self.device), self.picture, self.generator)
        self.zero_grad()
        self.load_state(state)

    def hand_over(self) -> None:
        """Convert the strokes for the last renderer, and remove surplus strokes."""
        self.is_handed_over = True
        self.picture.aim(self.picture.own_target, self.picture.own_background)
        while self.schedule.end_stage():
            pass
        if self.stage != self.schedule.stage:
            self._begin_stage()
        if (surplus := len(self.catalogue) - self.budget) > 0:  # the run ended before the density policy removed them
            ranks = self._measure_importance().argsort(stable=True).argsort()
            self._revise(ranks >= surplus, Strokes.none(self.catalogue.scale))
        if self.components.density.chooses_number:
            self.components.density.conclude(self._state_for_policy(self.draw_whole()))

    def state(self) -> dict[str, Any]:
        """Return everything that steps depend on, except the strokes and the optimiser, as plain data."""
        return {
            "stage": self.stage,
            "schedule": self.schedule.state_dict(),
            "depth": self.depth.state_dict(),
            "sampler": self.components.sampler.state_dict(),
            "density": self.components.density.state_dict(),
            "losses": state_of(self.components.losses),
            "changes": {name: change.state_dict() for name, change in self.changes.items()},
            "evaluations": self.evaluations,
            "visits": self.visits,
            "picture": None if self.picture.memory is None else self.picture.memory.picture,
            "anytime": self.anytime,
            "generator": self.generator.get_state(),
            "torch": torch.get_rng_state(),
        }

    def load_state(self, state: dict[str, Any]) -> None:
        """Restore the data returned by `state`, and resize the catalogue for the strokes that will be loaded next."""
        device = self.picture.target.device
        self._use_stage(state["stage"])
        self.catalogue.resize(len(state["visits"]))
        self.schedule.load_state_dict(state["schedule"])
        self.depth.load_state_dict(state["depth"], device)
        self.components.sampler.load_state_dict(state["sampler"])
        self.components.density.load_state_dict(state["density"])
        restore(self.components.losses, state["losses"])
        for name, change in self.changes.items():
            change.load_state_dict(state.get("changes", {}).get(name, {}))
        self.evaluations = state["evaluations"]
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
        todays_loops(checkpoint["loops"]["fit_loop"])
        self.load_state(checkpoint["painter"])

    def _use_stage(self, stage: int) -> None:
        self.stage = stage
        self.picture.forget()
        self.picture.renderer = self.components.stages[stage].renderer

    @torch.no_grad()
    def _begin_changes(self) -> None:
        first = strokes = self.catalogue()
        for change in self.changes.values():
            strokes = change.begin(strokes, self.now())
        if strokes is not first:
            self.catalogue.replace(strokes)

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
            if STEP_COUNT in group:  # the step count of pytorch_optimizer
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
                "step %d: switching to renderer %s; %d of %d strokes were converted to strokes it can draw",
                self.schedule.step, self.components.stages[stage].name, changed, len(strokes),
            )  # fmt: skip


@contextmanager
def rollback_on_error(catalogue: Catalogue) -> Iterator[Strokes]:
    """Yield the strokes of a catalogue, and restore them if an error is raised within the ``with`` block."""
    with torch.no_grad():
        before = catalogue()
    try:
        yield before
    except BaseException:
        catalogue.replace(before)
        raise
