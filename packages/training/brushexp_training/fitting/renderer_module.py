"""Train a renderer on pictures of strokes, optionally with a critic."""

import logging
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import lightning as L
import torch
from lightning.pytorch.utilities.types import OptimizerLRScheduler
from torch import Tensor, nn, optim
from torch.nn import functional

from brushexp.contracts.families import Renderer, window_pictures
from brushexp.contracts.pictures import psnr_of
from brushexp_training.evaluation.evaluation import error_figures, error_sums, fine_detail, premultiply
from brushexp_training.fitting.network_module import NetworkModule
from brushexp_training.rules import check_trainable
from brushexp_training.stroke_sets.datamodule import StrokeBatch

BETAS = (0.9, 0.99)  # betas of Adam for the renderer
CRITIC_BETAS = (0.5, 0.99)  # for the critic, and for a renderer trained with one, because their targets move
SLOPE = 0.2  # slope of the critic's leaky ReLU
SMALLEST_FEATURE_MAP = 4  # side in pixels of the input of the critic's dense layers
MOST_CHANNELS = 256
DENSE = (256, 64)
START_STEPS = 200  # number of steps after which each start is judged
MOST_STARTS = 3  # maximum number of fresh starts
ALIVE = 0.01  # minimum share of the true variance among strokes that a learning network draws

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class RendererSettings:
    """The settings for training a renderer; duration and precision are set by the Trainer."""

    lr: float = 5e-4  # peak learning rate
    detail: float = 1.0  # weight of errors in the finest detail of alpha (`fine_detail`)
    tone: float = 4.0  # weight of errors of the straight colour where there is paint, as light on ridges is faint
    critic: bool = False  # whether a critic judges the pictures in addition to L2
    critic_lr: float = 2e-3  # rate of the faster of two time scales (Heusel et al., 2017, arXiv:1706.08500)
    critic_weight: float = 0.1  # length of the critic's gradient as a share of the gradient of L2 (`balance`)
    critic_width: int = 16  # channels of the critic at full size


def relativistic_loss(above: Tensor, below: Tensor) -> Tensor:
    """Compute the RaSGAN loss, which is small if ``above`` has higher scores than ``below``.

    It is -E[log sigma(D(a) - E D(b))] - E[log(1 - sigma(D(b) - E D(a)))] for scores (n,) and (m,) without a sigmoid
    (Jolicoeur-Martineau, 2018, arXiv:1807.00734), computed with softplus to stay finite. The thesis misplaces a bracket
    in equations 4.6 to 4.10.
    """
    return functional.softplus(below.mean() - above).mean() + functional.softplus(below - above.mean()).mean()


class Critic(nn.Module):
    """VGG encoder: three convolutions and pooling at each size down to 4 x 4 pixels, then three dense layers.

    Source: thesis 2020, 6.2. The ``window`` in pixels is 4 times a power of two; the number of channels, which is
    ``width`` at full size, doubles with each pooling, up to 256.
    """

    def __init__(self, window: int, width: int) -> None:
        super().__init__()
        layers: list[nn.Module] = []
        before, side = 4, window
        while side > SMALLEST_FEATURE_MAP:
            channels = min(width * window // side, MOST_CHANNELS)
            for _ in range(3):
                layers += [nn.Conv2d(before, channels, 3, padding=1), nn.LeakyReLU(SLOPE)]
                before = channels
            layers.append(nn.AvgPool2d(2))
            side //= 2
        layers.append(nn.Flatten())
        sizes = [before * SMALLEST_FEATURE_MAP**2, *DENSE]
        for inputs, outputs in zip(sizes, DENSE, strict=False):
            layers += [nn.Linear(inputs, outputs), nn.LeakyReLU(SLOPE)]
        layers.append(nn.Linear(DENSE[-1], 1))
        self.layers = nn.Sequential(*layers)
        for convolution in (layer for layer in layers if isinstance(layer, nn.Conv2d)):
            nn.init.kaiming_normal_(convolution.weight, a=SLOPE)
        self.to(memory_format=torch.channels_last)  # type: ignore[call-overload]  # a fifth faster on a processor

    def forward(self, pictures: Tensor) -> Tensor:
        """Compute unbounded scores (n,) for premultiplied RGBA pictures (n, 4, S, S)."""
        return self.layers(2 * pictures - 1)[:, 0].float()


class RendererModule(NetworkModule):
    """Module that trains a renderer to reproduce the true pictures of strokes; see `evaluation.squared_error`.

    Lightning manages only the renderer's optimiser, so that ``global_step`` counts its steps alone; the critic's step
    is taken within ``training_step``. Raises UserError if the renderer has no weights, or if its windows are not
    ``window`` pixels wide.
    """

    clip_norm = 1.0

    def __init__(self, renderer: Renderer, window: int, settings: RendererSettings) -> None:
        super().__init__()
        check_trainable(renderer, window)
        self.renderer, self.window, self.settings = renderer.train(), window, settings
        self.critic = Critic(window, settings.critic_width) if settings.critic else None
        self._restored: dict[str, Any] = {}  # state of a checkpoint until it can be applied

    def configure_optimizers(self) -> OptimizerLRScheduler:
        settings = self.settings
        trained = [parameter for parameter in self.renderer.parameters() if parameter.requires_grad]
        betas = BETAS if self.critic is None else CRITIC_BETAS
        optimizer = optim.AdamW(trained, settings.lr, betas, weight_decay=1e-4)
        if self.critic is not None:
            weights = self.critic.parameters()
            self.critic_optimizer = optim.AdamW(weights, settings.critic_lr, CRITIC_BETAS, weight_decay=0.0)
            self.critic_schedule = self.schedule(self.critic_optimizer)
            if "critic" in self._restored:
                self.critic_optimizer.load_state_dict(self._restored["critic"]["optimizer"])
                self.critic_schedule.load_state_dict(self._restored["critic"]["schedule"])
        return {"optimizer": optimizer, "lr_scheduler": {"scheduler": self.schedule(optimizer), "interval": "step"}}

    def lr_scheduler_step(self, scheduler: Any, metric: Any) -> None:
        scheduler.step()
        if self.critic is not None:
            self.critic_schedule.step()

    def training_step(self, batch: StrokeBatch, batch_idx: int) -> Tensor:
        drawn = window_pictures(self.renderer, batch.parameters, self.window, batch.number).float()
        (color, _), (true_color, paint) = drawn.split([3, 1], dim=1), batch.images.split([3, 1], dim=1)
        lit = (paint * (color - true_color)).square().mean()
        drawn, truth = premultiply(drawn), premultiply(batch.images)
        wrong = drawn - truth
        error, fine = wrong.square().mean(), fine_detail(wrong[:, 3:]).square().mean()
        self.terms = {"loss/l2": error.detach(), "loss/detail": fine.detach(), "loss/tone": lit.detach()}
        loss = error + self.settings.detail * fine
        if self.critic is not None:
            self._step_critic(self.critic, drawn.detach(), truth)
            self.terms["loss/adversarial"], slope = self._ask_critic(self.critic, drawn, truth, loss)
            pulled = (drawn * slope).sum()  # a loss whose gradient with respect to the pictures is the slope
            loss = pulled + (loss - pulled).detach()  # has this gradient and the value of the error
        self.seen += len(drawn)
        return loss + self.settings.tone * lit

    def on_validation_epoch_start(self) -> None:
        self._sums = torch.zeros(5, dtype=torch.float64)

    def validation_step(self, batch: StrokeBatch, batch_idx: int) -> Tensor:
        """Draw the pictures (B, 4, S, S) of a batch in 32-bit precision, as in painting, for use by callbacks."""
        with torch.autocast(self.device.type, enabled=False):
            drawn = window_pictures(self.renderer, batch.parameters, self.window, batch.number)
        self._sums += error_sums(drawn, batch.images)
        return drawn

    def on_validation_epoch_end(self) -> None:
        self.figures, self.validated = error_figures(self._sums), self.global_step
        self.log_dict({f"validation/{name}": value for name, value in self.figures.items()})

    def on_save_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        super().on_save_checkpoint(checkpoint)
        state: dict[str, Any] = {"torch": torch.get_rng_state()}  # networks may sample noise
        if self.device.type == "cuda":
            state["cuda"] = torch.cuda.get_rng_state(self.device)
        if self.critic is not None:
            schedule, optimizer = self.critic_schedule.state_dict(), self.critic_optimizer.state_dict()
            state["critic"] = {"optimizer": optimizer, "schedule": schedule}
        checkpoint["renderer_module"] = state

    def on_load_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        super().on_load_checkpoint(checkpoint)
        self._restored = checkpoint["renderer_module"]

    def on_train_start(self) -> None:
        state, self._restored = self._restored, {}
        if state:  # restored only now, because Lightning draws random numbers before
            torch.set_rng_state(state["torch"].cpu())
            if "cuda" in state and self.device.type == "cuda":
                torch.cuda.set_rng_state(state["cuda"].cpu(), self.device)

    def state_line(self) -> str:
        quality = f"  held out {self.figures['psnr_alpha']:.2f} dB" if self.figures else ""
        speed = self.seen / max(self.seconds, 1e-9)
        loss = float(self.terms["loss/l2"])
        return f"L2 {loss:.5f} ({psnr_of(loss):.2f} dB){quality}  {speed:.0f} strokes/s"

    def _step_critic(self, critic: Critic, drawn: Tensor, truth: Tensor) -> None:
        critic.requires_grad_(True)
        loss = relativistic_loss(critic(truth), critic(drawn))
        self.critic_optimizer.zero_grad(set_to_none=True)
        loss.backward()
        self.terms["loss/critic"] = loss.detach()
        if self.check_is_finite(nn.utils.clip_grad_norm_(critic.parameters(), self.clip_norm)):
            self.critic_optimizer.step()

    def _ask_critic(self, critic: Critic, drawn: Tensor, truth: Tensor, error: Tensor) -> tuple[Tensor, Tensor]:
        """Compute the renderer's adversarial loss, and a gradient with respect to the pictures.

        `balance` combines the gradients of the reconstruction ``error`` and of the adversarial loss.
        """
        critic.requires_grad_(False)
        loss = relativistic_loss(critic(drawn), critic(truth))
        (pull,) = torch.autograd.grad(loss, drawn)
        (push,) = torch.autograd.grad(error, drawn, retain_graph=True)
        return loss.detach(), balance(push, pull, self.settings.critic_weight)


def balance(push: Tensor, pull: Tensor, weight: float) -> Tensor:
    """Add to ``push`` a vector in the direction of ``pull`` whose norm is ``weight`` times that of ``push``.

    A critic's scores have no fixed scale: in 80 steps, their gradients grew a thousandfold relative to the gradients of
    L2, so no constant weight works (Esser et al., 2021, arXiv:2012.09841, balance the gradients at the last layer).
    """
    return push + weight * torch.linalg.vector_norm(push) / torch.linalg.vector_norm(pull).clamp_min(1e-30) * pull


class FreshStart(L.Callback):
    """Callback that restarts a network which draws all strokes alike, with the weights of ``fresh()``.

    Such a network cannot learn, because its gradients vanish. Its weights are replaced at most ``most`` times.
    """

    def __init__(self, fresh: Callable[[], nn.Module], most: int = MOST_STARTS) -> None:
        self.fresh, self.most, self.restarts, self.lives = fresh, most, 0, False

    def state_dict(self) -> dict[str, Any]:
        return {"restarts": self.restarts, "lives": self.lives}

    def load_state_dict(self, state_dict: dict[str, Any]) -> None:
        self.restarts, self.lives = state_dict["restarts"], state_dict["lives"]

    def on_train_batch_end(self, trainer: L.Trainer, pl_module: Any, outputs: Any, batch: Any, batch_idx: int) -> None:
        if self.lives or self.restarts >= self.most or pl_module.global_step < START_STEPS * (self.restarts + 1):
            return
        with torch.no_grad():
            drawn = window_pictures(pl_module.renderer, batch.parameters, pl_module.window, batch.number)
        if (share := share_drawn(drawn, batch.images)) is None:
            return  # only one stroke
        self.lives = share >= ALIVE
        if not self.lives:
            self.restarts += 1
            pl_module.renderer.load_state_dict(self.fresh().state_dict())
            for optimizer in trainer.optimizers:
                optimizer.state.clear()
            log.warning(
                "step %d: the network draws all strokes alike (%.2g %% of the variance of true strokes); "
                "restarted with fresh weights, %d of %d times; fresh_starts=0 turns this off",
                *(pl_module.global_step, 100 * share, self.restarts, self.most),
            )


def share_drawn(drawn: Tensor, true: Tensor) -> float | None:
    """Compute the variance of alpha among drawn strokes (n, 4, S, S), as a fraction of that among true strokes.

    Both variances are averaged over pixels. The result is None if the true strokes do not vary, as with a single
    stroke.
    """
    ours, theirs = (float(pictures[:, 3].float().var(0, unbiased=False).mean()) for pictures in (drawn, true))
    return ours / theirs if theirs else None
