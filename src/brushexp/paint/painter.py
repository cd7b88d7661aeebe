"""The optimisation: gradient steps over the catalogue, as a LightningModule."""

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
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
from brushexp.strokes.catalogue import Catalogue

SECONDS_PER_CALL = 0.2  # one training step of Lightning takes as many gradient steps as fit, so that its own cost hides


@dataclass(frozen=True)
class Parts:
    """What a painting is made with: one member of each family."""

    renderer: Renderer
    blend: Blend
    order: Order
    losses: Mapping[str, Loss]
    density: Density
    sampler: Sampler
    optimizer: Optimizer


class Painter(L.LightningModule):
    """Moves strokes until the picture matches the target. The renderer stays frozen.

    Args:
        catalogue: the strokes.
        parts: how they are drawn, compared and moved.
        target: (3, H, W) in [0, 1].
        background: (3,) colour of the bare canvas.
        steps: gradient steps in all.
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
        steps: int,
        seed: int,
        watch: Callable[[int], None] = lambda step: None,
    ) -> None:
        super().__init__()
        self.automatic_optimization = False
        self.strict_loading = False  # frozen networks are not in the checkpoint
        self.catalogue = catalogue
        self.parts = parts
        self.renderer = parts.renderer.requires_grad_(False)
        self.losses = nn.ModuleDict(parts.losses)
        self.register_buffer("target", target, persistent=False)
        self.register_buffer("background", background, persistent=False)
        self.steps = steps
        self.watch = watch
        self.generator = torch.Generator().manual_seed(seed)
        self.step = 0
        self.stop = ""  # set from outside: finish after the present step, for this reason
        self.seconds = 0.0  # of wall time in the fit so far
        self.terms: dict[str, Tensor] = {}  # the losses of the last step, unweighted
        self._last: tuple[Tensor, Tensor] | None = None  # picture and target that the last step compared
        self._accuracy: Tensor | None = None
        self._renew_order()

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
            "seconds": self.seconds,
            "generator": self.generator.get_state(),
            "torch": torch.get_rng_state(),
            "accuracy": self._accuracy,
            "front_to_back": self.front_to_back,
        }

    def on_load_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        state = checkpoint["painter"]
        self.step, self.seconds = state["step"], state["seconds"]
        self.generator.set_state(state["generator"])
        torch.set_rng_state(state["torch"])
        self._accuracy = state["accuracy"]
        self.front_to_back = state["front_to_back"]

    def _take_step(self, optimizer: optim.Optimizer) -> None:
        if self.step % self.parts.order.every == 0:
            self._renew_order()
        for group in optimizer.param_groups:
            group["lr"] = self.parts.optimizer.rate(self.step / self.steps)
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
        self.step += 1
        assert painting is not None
        revision = self.parts.density.revise(painting, self.step, self.steps)
        if revision is not None:
            self.catalogue.revise(revision.keep, revision.new, optimizer)
            self._accuracy = None
            self._renew_order()
        self.watch(self.step)

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
    def _renew_order(self) -> None:
        self.front_to_back = front_to_back(self.parts.order.depth(self.catalogue(), self._accuracy))
