"""Training a renderer on pictures of strokes, as a LightningModule."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import lightning as L
import torch
from torch import Tensor, nn, optim
from torch.optim.swa_utils import AveragedModel, get_ema_multi_avg_fn

from brushexp.errors import UserError
from brushexp.plugins.renderer.base import Renderer, window_pictures
from brushexp.training.adversarial import Critic, relativistic_loss
from brushexp.training.datamodule import StrokeBatch
from brushexp.training.evaluation import Errors, decibels, errors_of, premultiplied

WARMUP, WARMUP_SHARE = 200, 0.1  # steps, or share of a short training, over which the learning rate rises
FINAL_RATE = 0.01  # of the learning rate, at the end
BETAS = (0.9, 0.99)  # of Adam, for the renderer
CRITIC_BETAS = (0.5, 0.99)  # for the critic, and for the renderer beside one: their aims move
WEIGHT_DECAY = 1e-4
CLIP = 1.0  # longest gradient
LOGGED = 20  # steps between two points of the curves
EXAMPLES = 24  # held-out strokes that are shown


@dataclass(frozen=True)
class Training:
    """How a renderer is trained.

    Attributes:
        lr: highest learning rate.
        epochs: passes through the data; None without a limit.
        minutes: of wall time; None without a limit. The learning rate falls to its end with the first limit reached.
        ema: share of the old weights that the averaged weights keep at each step, 0 (no averaging) to below 1.
        bfloat16: compute pictures and activations of training in 16 bits; weights and errors stay 32-bit.
        critic: whether a critic judges the pictures beside L2.
        critic_lr: its learning rate; a higher one than the renderer's is the two-time-scale rule (Heusel et al., 2017,
            arXiv:1706.08500).
        critic_weight: how hard the critic pulls at the pictures, as a share of how hard L2 does (`balanced`).
        critic_width: its channels at full size.
    """

    lr: float = 1e-3
    epochs: int | None = None
    minutes: float | None = None
    ema: float = 0.999
    bfloat16: bool = False
    critic: bool = False
    critic_lr: float = 4e-4
    critic_weight: float = 0.1
    critic_width: int = 16

    def __post_init__(self) -> None:
        if self.epochs is None and self.minutes is None:
            raise UserError("neither epochs nor minutes is set, so training would never end; set minutes=60")
        for name in ("lr", "critic_lr", "minutes"):
            value = getattr(self, name)
            if value is not None and not (math.isfinite(value) and value > 0):
                raise UserError(f"{name}={value:g} is not a positive number; give {name} another value")
        if not 0 <= self.ema < 1:
            raise UserError(f"ema={self.ema:g} is not a share from 0 to below 1; try ema=0.999")


class RendererTrainer(L.LightningModule):
    """Moves the weights of a renderer until its pictures are those of the strokes.

    The loss is `evaluation.squared_error`; what is judged, shown and kept are the averaged weights.

    Args:
        renderer: any with weights; it is trained in place.
        window: pixels on the side of the pictures.
        training: how.

    Attributes:
        step: steps taken.
        seconds: of wall time in the fit so far.
        stop: set from outside: finish after the present step, for this reason.
        figures: of the last validation, `Errors.figures`; empty before the first.
        examples: held-out strokes as the renderer drew them and as they are, each (n, 4, S, S); None before the first.

    Raises:
        UserError: if the renderer has nothing to train, or its windows are of another size.
    """

    def __init__(self, renderer: Renderer, window: int, training: Training) -> None:
        super().__init__()
        self.automatic_optimization = False
        if not any(parameter.requires_grad for parameter in renderer.parameters()):
            raise UserError("this renderer has no weights to train; try renderer=neural")
        own = getattr(renderer, "window", window)
        if own != window:
            raise UserError(
                f"renderer.window={own}, but the strokes have {window} pixels; set renderer.window={window}"
            )
        self.renderer = renderer.train()
        self.average = AveragedModel(renderer, multi_avg_fn=self._blend, use_buffers=True).requires_grad_(False)
        self.critic = Critic(window, training.critic_width) if training.critic else None
        self.window = window
        self.training_plan = training
        self.step = 0
        self.seconds = 0.0
        self.strokes_per_second = 0.0
        self.stop = ""
        self.loss = math.nan  # L2 of the last step
        self.figures: dict[str, float] = {}
        self.judged = -1  # the step at which `figures` were measured
        self.examples: tuple[Tensor, Tensor] | None = None
        self._errors = Errors()
        self._shown: list[tuple[Tensor, Tensor]] = []

    @property
    def averaged(self) -> Renderer:
        """The renderer with the averaged weights: what is judged and kept."""
        renderer = self.average.module
        assert isinstance(renderer, Renderer)
        return renderer

    @property
    def progress(self) -> float:
        """How much of the training is done, 0 to 1."""
        plan = self.training_plan
        shares = [0.0]
        if plan.epochs is not None:
            shares.append(self.step / max(1, plan.epochs * int(self.trainer.num_training_batches)))
        if plan.minutes is not None:
            shares.append(self.seconds / (60 * plan.minutes))
        return min(1.0, max(shares))

    def configure_optimizers(self) -> Sequence[optim.Optimizer]:
        plan = self.training_plan
        found = [parameter for parameter in self.renderer.parameters() if parameter.requires_grad]
        betas = BETAS if self.critic is None else CRITIC_BETAS
        optimizers = [optim.AdamW(found, plan.lr, betas, weight_decay=WEIGHT_DECAY)]
        if self.critic is not None:
            optimizers.append(optim.AdamW(self.critic.parameters(), plan.critic_lr, CRITIC_BETAS, weight_decay=0.0))
        return optimizers

    def on_fit_start(self) -> None:
        self._clock = time.monotonic()

    def training_step(self, batch: StrokeBatch, batch_idx: int) -> None:
        optimizers = self.optimizers(use_pl_optimizer=False)
        pair = optimizers if isinstance(optimizers, list) else [optimizers]
        self._set_rates(pair)
        batch = StrokeBatch(*batch)
        drawn = premultiplied(self._draw(batch))
        truth = premultiplied(batch.images)
        squared = (drawn - truth).square().mean()
        curves = {"loss/l2": squared.detach()}
        slope = None
        if self.critic is not None:
            curves["loss/critic"] = self._teach(self.critic, pair[1], drawn.detach(), truth)
            curves["loss/adversarial"], slope = self._ask(self.critic, drawn, truth)
        _descend(pair[0], squared if slope is None else drawn, slope, self.renderer)
        self.average.update_parameters(self.renderer)
        self.step += 1
        self.loss = float(squared.detach())
        if self.step % LOGGED == 0:
            self._note({**curves, "lr": pair[0].param_groups[0]["lr"]})
        self._take_time(len(drawn))
        if self.progress >= 1:
            self.trainer.should_stop = True

    def on_validation_epoch_start(self) -> None:
        self._errors, self._shown = Errors(), []

    def validation_step(self, batch: StrokeBatch, batch_idx: int) -> None:
        batch = StrokeBatch(*batch)
        drawn = window_pictures(self.averaged, batch.parameters, self.window, batch.number)
        self._errors += errors_of(drawn, batch.images)
        if sum(len(images) for images, _ in self._shown) < EXAMPLES:
            self._shown.append((drawn.cpu(), batch.images.cpu()))

    def on_validation_epoch_end(self) -> None:
        self.figures, self.judged = self._errors.figures(), self.step
        drawn, truth = (torch.cat(parts)[:EXAMPLES] for parts in zip(*self._shown, strict=True))
        self.examples = (drawn, truth)
        self._note({f"validation/{name}": value for name, value in self.figures.items()})

    def on_save_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        state = {"step": self.step, "seconds": self.seconds, "torch": torch.get_rng_state()}
        if self.device.type == "cuda":
            state["cuda"] = torch.cuda.get_rng_state(self.device)
        checkpoint["renderer_trainer"] = state

    def on_load_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        state = checkpoint["renderer_trainer"]
        self.step, self.seconds = state["step"], state["seconds"]
        self._random = state

    def on_train_start(self) -> None:
        state = self.__dict__.pop("_random", None)  # here, because Lightning itself draws numbers before
        if state is not None:
            torch.set_rng_state(state["torch"].cpu())
            if "cuda" in state and self.device.type == "cuda":
                torch.cuda.set_rng_state(state["cuda"].cpu(), self.device)

    def state_line(self) -> str:
        """Loss, quality and speed in a few words."""
        quality = f"  held out {self.figures['psnr_alpha']:.2f} dB" if self.figures else ""
        return f"L2 {self.loss:.5f} ({decibels(self.loss):.2f} dB){quality}  {self.strokes_per_second:.0f} strokes/s"

    def _note(self, curves: Mapping[str, Tensor | float]) -> None:
        """Add points to the curves; past `log`, whose steps are those of automatic optimisation."""
        for logger in self.loggers:
            logger.log_metrics({name: float(value) for name, value in curves.items()}, step=self.step)

    def _draw(self, batch: StrokeBatch) -> Tensor:
        with torch.autocast(self.device.type, torch.bfloat16, enabled=self.training_plan.bfloat16):
            drawn = window_pictures(self.renderer, batch.parameters, self.window, batch.number)
        return drawn.float()

    def _set_rates(self, optimizers: Sequence[Any]) -> None:
        """Linear rise, then half a cosine down to `FINAL_RATE` of the highest rate."""
        plan = self.training_plan
        share = FINAL_RATE + (1 - FINAL_RATE) * 0.5 * (1 + math.cos(math.pi * self.progress))
        share *= min(1.0, max((self.step + 1) / WARMUP, self.progress / WARMUP_SHARE))
        for optimizer, highest in zip(optimizers, (plan.lr, plan.critic_lr), strict=False):
            for group in optimizer.param_groups:
                group["lr"] = share * highest

    def _teach(self, critic: Critic, optimizer: optim.Optimizer, drawn: Tensor, truth: Tensor) -> Tensor:
        """One step of the critic, true pictures above drawn ones; its loss."""
        critic.requires_grad_(True)
        loss = relativistic_loss(self._scores(critic, truth), self._scores(critic, drawn))
        _descend(optimizer, loss, None, critic)
        return loss.detach()

    def _ask(self, critic: Critic, drawn: Tensor, truth: Tensor) -> tuple[Tensor, Tensor]:
        """The renderer's side, drawn pictures above true ones: its loss, and where L2 and critic push the pictures."""
        critic.requires_grad_(False)
        loss = relativistic_loss(self._scores(critic, drawn), self._scores(critic, truth))
        (pull,) = torch.autograd.grad(loss, drawn)
        push = (2 / drawn.numel()) * (drawn.detach() - truth)
        return loss.detach(), balanced(push, pull, self.training_plan.critic_weight)

    def _scores(self, critic: Critic, pictures: Tensor) -> Tensor:
        with torch.autocast(self.device.type, torch.bfloat16, enabled=self.training_plan.bfloat16):
            scores: Tensor = critic(pictures)
        return scores

    def _take_time(self, strokes: int) -> None:
        now = time.monotonic()
        spent, self._clock = now - self._clock, now
        self.seconds += spent
        speed = strokes / max(spent, 1e-9)
        self.strokes_per_second += (speed - self.strokes_per_second) * (0.05 if self.strokes_per_second else 1.0)

    def _blend(self, averages: Any, weights: Any, count: Any) -> None:
        """Move the averages; early ones forget faster, as they are mostly of random weights."""
        kept = min(self.training_plan.ema, (1 + int(count)) / (10 + int(count)))
        get_ema_multi_avg_fn(kept)(averages, weights, count)


def balanced(push: Tensor, pull: Tensor, weight: float) -> Tensor:
    """``push``, and ``weight`` times a vector of the same length in the direction of ``pull``.

    The scores of a critic have no scale: in 80 steps their gradients grew a thousandfold against those of L2, so no
    fixed weight of the losses would do (Esser et al., 2021, arXiv:2012.09841, balance them at the last layer).
    """
    return push + weight * torch.linalg.vector_norm(push) / torch.linalg.vector_norm(pull).clamp_min(1e-30) * pull


def _descend(optimizer: optim.Optimizer, values: Tensor, slope: Tensor | None, module: nn.Module) -> None:
    """One step down the clipped gradient of a loss, or of ``values`` times their ``slope``."""
    optimizer.zero_grad(set_to_none=True)
    values.backward(slope)
    nn.utils.clip_grad_norm_(module.parameters(), CLIP)
    optimizer.step()
