"""The optimisation: one gradient step over the strokes after another, as a LightningModule."""

import logging
from typing import Any

import torch
from torch import Tensor
from torch.optim.lr_scheduler import LambdaLR

from brushexp.painting.components import Components
from brushexp.painting.densification import Densification
from brushexp.painting.divergence import first_broken
from brushexp.painting.painter_state import compile_kernels, load_painter_state, painter_state
from brushexp.painting.painting_module import PaintingModule
from brushexp.painting.partial import STEP_COUNT, partial_update, unwrapped
from brushexp.painting.picture import Picture
from brushexp.painting.schedule import Schedule
from brushexp.pictures.region import Region
from brushexp.plugins.loss.base import weighted_sum
from brushexp.plugins.sampler.base import View
from brushexp.strokes.bezier import curve_of, half_width_of
from brushexp.strokes.catalogue import Catalogue, Strokes, check_strokes
from brushexp.system.callbacks import DIVERGED

log = logging.getLogger(__name__)
CHANGE_PIXELS = 0.01  # by which a renderer may change a stroke without its being counted


class Painter(PaintingModule):
    """Moves strokes until the picture matches the target. Renderers stay frozen.

    The steps go through the stages one after another. When one begins, its renderer converts the strokes, and the
    optimiser and the schedule of its learning rate start afresh. The first steps, the share ``coarse`` of the first
    stage, look at the whole picture at half its size; meanwhile no strokes come or go. An epoch is 100 steps, and a fit
    ends with the last step, in the midst of one.

    >>> import lightning as L
    >>> from brushexp.plugins.init.random import Random
    >>> from brushexp.painting.components import standard_components
    >>> target, components = torch.rand(3, 24, 32), standard_components(steps=3)
    >>> strokes = Random()(target, 20, torch.Generator())
    >>> painter = Painter(Catalogue(strokes, components.optimizer.units), components, target, torch.ones(3), seed=0)
    >>> quiet = {"logger": False, "enable_checkpointing": False, "enable_progress_bar": False}
    >>> trainer = L.Trainer(max_epochs=-1, enable_model_summary=False, **quiet)
    >>> trainer.fit(painter)
    >>> trainer.global_step, painter.drawn().shape
    (3, torch.Size([3, 24, 32]))
    """

    resumable = True
    visits: Tensor  # (N,) steps that each stroke has taken
    stage: int  # number of the one whose renderer draws the strokes
    _searching: bool  # whether strokes are elsewhere than at the beginning of the step

    def __init__(
        self,
        catalogue: Catalogue,
        components: Components,
        target: Tensor,  # (3, H, W) in [0, 1]
        background: Tensor,  # (3,) colour of the bare canvas
        *,
        seed: int,  # of everything random in the steps
        focus: Tensor | None = None,  # (H, W) how much each pixel counts in the losses, of mean 1; None for all alike
        budget: int | None = None,  # strokes that the density policy may come to; None for as many as there are
        coarse: float = 0.0,
    ) -> None:
        schedule = Schedule([stage.steps for stage in components.stages])
        super().__init__(components, Picture(target, focus, background, components.blend), schedule)
        self.strict_loading = False  # frozen networks are not in the checkpoint
        self.catalogue = catalogue
        self.coarse = coarse
        self.generator = torch.Generator().manual_seed(seed)
        parts = self.picture, self.depth, self.schedule, self.generator
        self.densification = Densification(components.density, budget or len(catalogue), *parts)
        self.register_buffer("visits", torch.zeros(len(catalogue), dtype=torch.long), persistent=False)
        self._begin_stage()

    @property
    def is_coarse(self) -> bool:
        """Whether the next step looks at the smaller picture."""
        done, steps = self.schedule.stage_progress
        return self.schedule.stage == 0 and done < self.coarse * steps

    @property
    def title(self) -> str:
        """Each stage has its own: a step of one may take a hundred times as long."""
        stages = self.components.stages
        return f"painting with {stages[self.schedule.stage].name}" if len(stages) > 1 else "painting"

    @torch.no_grad()
    def strokes(self) -> Strokes:
        return self.catalogue()

    def hand_over(self) -> None:
        """Give the strokes to the last renderer, whatever the steps: what a run leaves is always drawn by it."""
        while self.schedule.end_stage():
            pass
        if self.stage != self.schedule.stage:
            self._begin_stage()

    def configure_optimizers(self) -> Any:
        optimizer = self.components.optimizer.over(p for p in self.catalogue.parameters() if p.requires_grad)
        scheduler = LambdaLR(optimizer, lambda _: self.components.optimizer.share(self.progress))
        return {"optimizer": optimizer, "lr_scheduler": {"scheduler": scheduler, "interval": "step"}}

    def training_step(self, batch: Any, batch_idx: int) -> Tensor:
        """The weighted sum of the losses of what the step looks at; L-BFGS asks several times in a step."""
        self.evaluations += 1
        if self._searching:
            self._moving.keep_in_range()  # a line search may look anywhere
        self._searching = True
        canvas, painting = self.picture.see(
            self._moving(), self._strokes, self._view, self.depth.front_to_back,
            coarse=self.is_coarse, accuracy=self._measure,
        )  # fmt: skip
        self.depth.measured(canvas.accuracy, self._view.active, len(self.catalogue))
        total, terms = weighted_sum(self.components.losses, painting)
        self.terms = {name: term.detach() for name, term in terms.items()}
        return total if total.requires_grad else total.requires_grad_()

    def optimizer_step(self, epoch: int, batch_idx: int, optimizer: Any, optimizer_closure: Any = None) -> None:
        """One gradient step: look, move strokes, keep them drawable, and then add and remove some."""
        schedule, order = self.schedule, self.components.order
        if schedule.stage != self.stage:
            self._begin_stage(optimizer)
        if order.due(*schedule.stage_progress):
            self.depth.renew(self.strokes())
        coarse, before = self.is_coarse, self.strokes()
        view = self.next_view(before)
        with partial_update(self.catalogue, unwrapped(optimizer), view.active, self.visits) as moving:
            accuracy = self.depth.needs_accuracy(schedule, partial=view.active is not None)
            self.look_at(view, before, moving, accuracy=accuracy)
            well = False
            try:
                optimizer.step(closure=optimizer_closure)
                well = self._went_well(moving)
            finally:  # also after what a loss raises
                if not well:
                    moving.replace(before if view.active is None else before[view.active])
            moving.keep_in_range()
            strokes = moving()
            clamped = self.renderer.clamp(strokes)
            if clamped is not strokes:
                moving.replace(clamped)
        self.picture.moved(view.active)
        schedule.step += 1
        self._curves.step_taken(self)
        if not coarse:
            self.visits = self.densification.update(self.catalogue, self.visits, unwrapped(optimizer))

    def _went_well(self, moving: Catalogue) -> bool:
        """Whether a step has left numbers; if not, the fit ends with it."""
        wrong = next((name for name, term in self.terms.items() if not term.isfinite()), None)
        if wrong is None and moving.is_finite():
            return True
        rows = self._view.active
        what = first_broken(self, self._strokes if rows is None else self._strokes[rows], wrong)
        self.stop, self.trouble = DIVERGED, f"step {self.schedule.step + 1}: {what}"
        return False

    def prepare(self) -> None:
        check_strokes(self.strokes())  # those of a checkpoint
        compile_kernels(self)

    def on_save_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        state = checkpoint["state_dict"]
        checkpoint["state_dict"] = {key: state[key] for key in state if key.startswith("catalogue.")}
        checkpoint["painter"] = painter_state(self)

    def on_load_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        load_painter_state(self, checkpoint["painter"])

    def next_view(self, strokes: Strokes) -> View:
        """Where the next step looks, with the strokes as they are now."""
        if self.is_coarse:
            return View(Region.whole(self.picture.target))
        return self.components.sampler(strokes, self.picture.size, self.schedule.step, self.generator)

    def look_at(self, view: View, strokes: Strokes, moving: Catalogue, *, accuracy: bool = False) -> None:
        """Choose what `training_step` draws and compares, see `Picture.see`."""
        self._view, self._strokes, self._moving, self._measure = view, strokes, moving, accuracy
        self._searching = False

    def use_stage(self, stage: int) -> None:
        """Draw with the renderer of a stage from now on."""
        self.stage = stage
        self.picture.forget()
        self.picture.renderer = self.components.stages[stage].renderer

    @torch.no_grad()
    def _begin_stage(self, optimizer: Any = None) -> None:
        """Hand the strokes over to the renderer of the present stage, and let the optimiser start afresh."""
        self.use_stage(self.schedule.stage)
        self._convert()
        self.depth.renew(self.strokes())
        if optimizer is not None:
            unwrapped(optimizer).state.clear()
            self.visits.zero_()
            for group in optimizer.param_groups:
                group["lr"] = group["initial_lr"] * self.components.optimizer.share(0.0)
                if STEP_COUNT in group:  # where pytorch_optimizer counts
                    group[STEP_COUNT] = 0

    @torch.no_grad()
    def _convert(self) -> None:
        """Change the strokes to what the renderer can draw, and log how many are others now."""
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
