"""The optimisation: gradient steps over the catalogue, as a LightningModule."""

import copy
import logging
import math
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from itertools import accumulate
from typing import Any

import lightning as L
import torch
from torch import Tensor, nn, optim

from brushexp.compositing.bands import bands
from brushexp.errors import UserError
from brushexp.painting.anytime import Anytime
from brushexp.painting.canvas_memory import CanvasMemory
from brushexp.painting.components import Components
from brushexp.painting.importance import importance
from brushexp.painting.metrics import psnr_of
from brushexp.painting.partial import lend, take_back
from brushexp.painting.pyramid import Aim, enlarged
from brushexp.pictures.region import Region
from brushexp.plugins.blend.base import Canvas
from brushexp.plugins.density.base import DensificationState, DensificationUpdate
from brushexp.plugins.loss.base import Painting, weighted_sum
from brushexp.plugins.order.base import front_to_back
from brushexp.plugins.renderer.base import Renderer
from brushexp.plugins.sampler.base import View
from brushexp.strokes.bezier import curve_of, half_width_of
from brushexp.strokes.catalogue import Catalogue, Strokes

log = logging.getLogger(__name__)
SECONDS_PER_CALL = 0.2  # one training step of Lightning takes as many gradient steps as fit, so that its own cost hides
PLENTY = 10**6  # steps of a stage that is only tried: it stays at the beginning of its schedule
COARSE = 0.5  # sizes of the canvas: the picture of the coarse steps
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
        focus: (H, W) how much each pixel counts in the losses, of mean 1; None for all alike.
        coarse: share of the first stage's steps that come first and look at the whole picture at half its size;
            strokes are neither added nor removed meanwhile.
        budget: strokes that the density policy may come to; None for as many as there are.
        watch: called after every step with the number of steps done.
    """

    target: Tensor
    focus: Tensor | None
    background: Tensor
    front_to_back: Tensor
    visits: Tensor

    def __init__(
        self,
        catalogue: Catalogue,
        parts: Components,
        target: Tensor,
        background: Tensor,
        *,
        seed: int,
        focus: Tensor | None = None,
        budget: int | None = None,
        coarse: float = 0.0,
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
        self.register_buffer("focus", focus, persistent=False)
        self.register_buffer("background", background, persistent=False)
        if not 0 <= coarse < 1:
            raise UserError(f"coarse={coarse:g} is not a share of the steps from 0 to below 1; try coarse=0.5")
        self.coarse = coarse
        self.budget = len(catalogue) if budget is None else budget
        self.watch = watch
        self.generator = torch.Generator().manual_seed(seed)
        self.step = 0
        self.evaluations = 0  # of the losses so far; an optimiser may need several for a step
        # Steps that each stroke has taken.
        self.register_buffer("visits", torch.zeros(len(catalogue), dtype=torch.long), persistent=False)
        self.register_buffer("front_to_back", torch.arange(len(catalogue)), persistent=False)
        self.stop = ""  # set from outside: finish after the present step, for this reason
        self.seconds = 0.0  # of wall time in the fit so far, as of the last look at the clock
        self.clock: Callable[[], float] = time.monotonic
        self._looked: float | None = None  # at the clock; None outside the fit
        self.anytime = Anytime()  # how good the picture was after how many seconds
        self.terms: dict[str, Tensor] = {}  # the losses of the last step, unweighted
        self._last: Tensor | None = None  # the picture, maybe a small one, if the last step looked at all of it
        self._small: Aim | None = None  # of the coarse steps
        self._memory: CanvasMemory | None = None  # of a painter who looks at parts
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
    def elapsed(self) -> float:
        """Seconds of wall time in the fit until now."""
        return self.seconds + (0.0 if self._looked is None else self.clock() - self._looked)

    @property
    def is_coarse(self) -> bool:
        """Whether the next step looks at the smaller picture."""
        done, steps = self.progress
        return self.stage == 0 and done < self.coarse * steps

    @property
    def size(self) -> tuple[int, int]:
        """Height and width of the canvas."""
        return int(self.target.shape[1]), int(self.target.shape[2])

    @property
    def error(self) -> float:
        """Mean squared error of the whole picture as it was last seen; a small one counts as it looks enlarged."""
        if self._memory is not None:
            return self._memory.error
        if self._last is None:
            return self._error
        return Aim(self.target, self.focus).error(enlarged(self._last, self.size))

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
        if self._memory is not None:
            return self._memory.picture
        return self.picture() if self._last is None else enlarged(self._last, self.size)

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

    def rehearse(self, *, update: bool = True) -> None:
        """Go through one step without taking it, so that whatever is compiled or loaded at first use is there.

        With ``update`` also through what the density policy may ask for.
        """
        coarse, self.coarse = self.coarse, 0.0
        sampler = self.parts.sampler
        before, generator = sampler.state_dict(), self.generator.clone_state()
        view = sampler(self._strokes(), self.size, self.step, generator)
        sampler.load_state_dict(before)
        self._objective(self.catalogue if view.active is None else self.catalogue.part(view.active), view)
        self.zero_grad()
        self.evaluations, self.coarse = 0, coarse
        if update and self.parts.density.judges:
            state = self.generator.get_state()
            self._densification_state().importance()
            self.generator.set_state(state)

    @torch.no_grad()
    def trial(self, stage: int, share: float = 1.0, *, coarse: bool = False) -> "Painter":
        """A copy with a share of the strokes, at the beginning of a stage, to try steps on; this one stays as it is.

        Its steps are those over the full picture, or the ``coarse`` ones.
        """
        shared = [self.target, self.focus, self.background, self.clock, self.watch]
        shared += [*self.renderers, *self.losses.values()]
        memo: dict[int, Any] = {id(value): value for value in shared}
        memo |= {id(self._memory): None, id(self._last): None}  # pictures of other strokes, and large
        own = {name: copy.deepcopy(getattr(self.parts, name)) for name in ("order", "density", "sampler")}
        memo[id(self.parts)] = replace(self.parts, **own)
        trial = copy.deepcopy(self, memo)
        trial.coarse = float(coarse)
        trial.step, trial.ends = 0, [PLENTY * (k >= stage) for k in range(len(self.ends))]
        n = len(self.catalogue)
        rows = torch.linspace(0, n - 1, max(1, round(share * n))).long() if n else torch.arange(0)
        strokes = trial.renderer.convert(self._strokes()[rows.to(self.target.device)])
        trial.catalogue = Catalogue(strokes, self.catalogue.units)
        trial.visits, trial._accuracy, trial.watch = self.visits.new_zeros(len(strokes)), None, lambda step: None
        trial._renew_order()
        if trial.parts.sampler(strokes, self.size, 0, trial.generator).active is not None:
            trial._memory = trial._memory_of(torch.zeros_like(self.target))  # to draw all strokes may take long
        return trial

    @property
    def looks_at_parts(self) -> bool:
        """Whether the last step saw a part of the canvas only."""
        return self._memory is not None

    def advance(self, optimizer: optim.Optimizer, seconds: float) -> None:
        """Take steps until so many seconds are over: one at least, if any are left."""
        end = self.clock() + seconds
        while self.step < self.steps and not self.stop:
            self._take_step(optimizer)
            if self.clock() > end:
                break

    def on_fit_start(self) -> None:
        self._looked = self.clock()
        if not self.anytime.pairs:
            self.anytime.add(self.seconds, psnr_of(self.error))  # where the steps begin, if that was seen

    def on_fit_end(self) -> None:
        self._looked = None

    def training_step(self, batch: Any, batch_idx: int) -> None:
        optimizer = self.optimizers(use_pl_optimizer=False)
        assert isinstance(optimizer, optim.Optimizer)
        self.advance(optimizer, SECONDS_PER_CALL)
        self.seconds, self._looked = self.elapsed, self.clock()
        psnr = psnr_of(self.error)
        self.anytime.add(self.seconds, psnr)
        curves = {f"loss/{self.parts.losses[name].label or name}": term for name, term in self.terms.items()}
        self.log_dict({**curves, "psnr": psnr, "step": float(self.step), "seconds": self.seconds})

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
            "density": self.parts.density.state_dict(),
            "picture": None if self._memory is None else self._memory.picture,
            "ends": self.ends,
            "seconds": self.seconds,
            "anytime": self.anytime.pairs,
            "generator": self.generator.get_state(),
            "torch": torch.get_rng_state(),
            "accuracy": self._accuracy,
            "front_to_back": self.front_to_back,
        }

    def on_load_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        state = checkpoint["painter"]
        self.catalogue.resize(len(state["visits"]))
        self.step, self.ends, self.seconds = state["step"], state["ends"], state["seconds"]
        self.anytime = Anytime(state["anytime"])
        self.evaluations, self.visits = state["evaluations"], state["visits"].to(self.target.device)
        self.parts.sampler.load_state_dict(state["sampler"])
        self.parts.density.load_state_dict(state["density"])
        self.generator.set_state(state["generator"])
        torch.set_rng_state(state["torch"])
        device = self.target.device
        self.front_to_back = state["front_to_back"].to(device)
        self._accuracy = None if state["accuracy"] is None else state["accuracy"].to(device)
        self._memory = None if state["picture"] is None else self._memory_of(state["picture"].to(device))

    def _take_step(self, optimizer: optim.Optimizer) -> None:
        stage, order = self.stage, self.parts.order
        done, steps = self.progress
        if order.due(done, steps):
            self._renew_order()
        for group in optimizer.param_groups:
            group["lr"] = self.parts.optimizer.rate(done / steps)
        coarse = self.is_coarse
        view = self._view()
        judge = order.needs_accuracy and (view.active is not None or order.due(done + 1, steps))
        painting = self._move(optimizer, view, judge)
        self.step += 1
        if not coarse:
            self.parts.sampler.seen(view, painting.image.detach(), painting.target)
            update = self.parts.density.revise(self._densification_state())
            if update is not None:
                self._revise(update, optimizer)
        self.watch(self.step)
        if self.stage != stage:
            self._adopt()
            optimizer.state.clear()
            self.visits.zero_()

    def _view(self) -> View:
        if self.is_coarse:
            return View(Region(0, 0, *self._aim().size))
        return self.parts.sampler(self._strokes(), self.size, self.step, self.generator)

    def _aim(self) -> Aim:
        """What steps that look at the whole picture compare it with now."""
        if not self.is_coarse:
            return Aim(self.target, self.focus)
        if self._small is None:
            self._small = Aim(self.target, self.focus).smaller(COARSE)
        return self._small

    def _densification_state(self) -> DensificationState:
        """The painting as the density policy sees it."""
        strokes, focus, renderer = self._strokes(), self.focus, self.renderer
        judge = partial(
            importance, strokes, self.front_to_back, self.target, focus, self.background, renderer, self.parts.blend,
            self.generator,
        )  # fmt: skip
        return DensificationState(self.latest(), self.target, focus, strokes, self.budget, self.step, self.steps, judge)

    def _revise(self, update: DensificationUpdate, optimizer: optim.Optimizer) -> None:
        """Drop strokes and add others."""
        self.catalogue.revise(update.keep, self.renderer.convert(update.new), optimizer)
        self.visits = torch.cat([self.visits[update.keep], self._counted(len(update.new))])
        self._accuracy = None
        self._drop_memory()
        self._renew_order()

    def _move(self, optimizer: optim.Optimizer, view: View, judge: bool) -> Painting:
        """Let the optimiser move the strokes of a view; what it looked at last."""
        rows = view.active
        part, mover = self.catalogue, optimizer
        if rows is not None:
            part, mover = lend(self.catalogue, optimizer, self.parts.optimizer, rows, int(self.visits[rows].median()))
        painting: Painting | None = None

        def objective() -> Tensor:
            nonlocal painting
            mover.zero_grad(set_to_none=True)
            part.keep_in_range()  # a line search may look anywhere
            total, painting = self._objective(part, view, judge=judge)
            return total

        mover.step(objective)  # type: ignore[arg-type]
        part.keep_in_range()
        strokes = part()
        projected = self.renderer.clamp(strokes)
        if projected is not strokes:
            part.replace(projected)
        if rows is not None:
            if not take_back(self.catalogue, optimizer, part, mover, rows) and not self.step:
                log.info("%s cannot remember single strokes: each step begins afresh", type(mover).__name__)
            self.visits[rows] += 1
            if self._memory is not None:
                self._memory.kept.forget(rows)
        else:
            self.visits += 1
        assert painting is not None
        return painting

    def _objective(self, part: Catalogue, view: View, *, judge: bool = False) -> tuple[Tensor, Painting]:
        """The weighted sum of losses, after its gradient in the strokes of ``part`` has been computed."""
        self.evaluations += 1
        with torch.enable_grad():
            canvas, painting = self._paint(part(), view, judge=judge)
            total, terms = weighted_sum(self.parts.losses, painting)
            if total.requires_grad:
                total.backward()
        self.terms = {name: term.detach() for name, term in terms.items()}
        if canvas.accuracy is not None:
            self._judge(canvas.accuracy, view.active)
        return total.detach(), painting

    def _paint(self, strokes: Strokes, view: View, *, judge: bool) -> tuple[Canvas, Painting]:
        """What a view shows, differentiable in ``strokes``: those that it moves."""
        if view.active is None:
            aim = self._aim()
            strokes = strokes if aim.zoom == 1 else strokes.moved(zoom=aim.zoom)
            layers = self.renderer(strokes)
            target = aim.target if judge else None
            canvas = self.parts.blend(layers, self.front_to_back, aim.size, self.background, target)
            self._last = canvas.image.detach()
            if self._memory is not None and aim.zoom == 1:
                self._memory.saw(self._last)
            return canvas, Painting(canvas.image, aim.target, strokes, focus=aim.focus)
        if self._memory is None:
            self._memory = self._memory_of(self.picture())
        self._last = None
        return self._memory.paint(strokes, self._strokes(), view, self.front_to_back, judge=judge)

    def _drop_memory(self) -> None:
        """The strokes are others now, or drawn by another renderer."""
        if self._memory is not None:
            self._error, self._memory = self._memory.error, None

    def _memory_of(self, picture: Tensor) -> CanvasMemory:
        n, blend = len(self.catalogue), self.parts.blend
        return CanvasMemory(picture, self.target, self.background, self.renderer, blend, n, focus=self.focus)

    def _counted(self, n: int) -> Tensor:
        """Visits (n,) of new strokes: the optimiser counts them with the old ones (see `Catalogue.revise`)."""
        return self.visits.new_full((n,), int(self.visits.max()) if len(self.visits) else 0)

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
        adopted = stage.renderer.convert(strokes)
        if adopted is not strokes:
            self.catalogue.replace(adopted)
        self._drop_memory()
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
