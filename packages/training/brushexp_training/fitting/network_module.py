"""Base class for training a network, with a learning rate schedule, gradient clipping, and logged curves."""

import math
import time
from typing import Any

import lightning as L
import torch
from lightning.pytorch.callbacks import Timer
from torch import Tensor, nn
from torch.optim import Optimizer
from torch.optim.lr_scheduler import LambdaLR

from brushexp.contracts.runs import Status

WARMUP_STEPS, WARMUP_SHARE = 200, 0.1  # steps over which the rate rises, but at most this share of all steps
FINAL_RATE = 0.01  # final learning rate as a share of the peak


class NetworkModule(L.LightningModule):
    """Base class for training a network up to its Trainer's first limit: ``max_steps``, ``max_epochs`` or a `Timer`."""

    title = "training"  # label of the progress bar
    clip_norm: float | None = None  # maximum norm of the gradient unless the Trainer sets one

    def __init__(self) -> None:
        super().__init__()
        self.stop: Status | None = None  # reason why training ends before its limit
        self.trouble = ""  # reason why a step would have made weights non-finite; they stay as before that step
        self.terms: dict[str, Tensor] = {}  # losses of the last step
        self.seen = 0  # number of training strokes processed, including before an interruption
        self._cpu_seconds = 0.0  # CPU time of finished fits
        self._since: float | None = None  # CPU clock at the beginning of the current fit
        self.figures: dict[str, float] = {}  # figures of the last validation
        self.validated = -1  # step of the last validation

    @property
    def progress(self) -> float:
        # Trainer.estimated_stepping_batches would set up the data before their state is loaded from a checkpoint.
        trainer, shares = self.trainer, [0.0]
        if trainer.max_steps > 0:
            shares.append(self.global_step / trainer.max_steps)
        if trainer.max_epochs is not None and trainer.max_epochs > 0:
            steps = trainer.max_epochs * trainer.num_training_batches / trainer.accumulate_grad_batches
            shares.append(self.global_step / max(1, steps))
        for timer in self._timers():
            remaining, spent = timer.time_remaining(), timer.time_elapsed()
            shares += [] if remaining is None else [spent / max(spent + remaining, 1e-9)]
        return min(1.0, max(shares))

    @property
    def seconds(self) -> float:
        """The wall time of the fit so far in seconds, including the time before an interruption.

        It is 0 without a `Timer`.
        """
        return max((timer.time_elapsed() for timer in self._timers()), default=0.0)

    @property
    def cpu_seconds(self) -> float:
        """The CPU time of all threads in the fit so far, in seconds, including the time before an interruption."""
        return self._cpu_seconds + (0.0 if self._since is None else time.process_time() - self._since)

    def state_line(self) -> str:
        raise NotImplementedError

    def schedule(self, optimizer: Optimizer) -> LambdaLR:
        """Return a schedule that raises the learning rate linearly and then decays it along a half cosine.

        The final rate is a fraction `FINAL_RATE` of the peak.
        """

        def factor(_: int) -> float:
            share, rise = self.progress, (self.global_step + 1) / WARMUP_STEPS
            cosine = FINAL_RATE + (1 - FINAL_RATE) * 0.5 * (1 + math.cos(math.pi * share))
            return cosine * min(1.0, max(rise, share / WARMUP_SHARE))

        return LambdaLR(optimizer, factor)

    def on_fit_start(self) -> None:
        self._since = time.process_time()

    def on_fit_end(self) -> None:
        self._cpu_seconds, self._since = self.cpu_seconds, None

    def on_save_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        checkpoint |= {"seen": self.seen, "cpu_seconds": self.cpu_seconds}

    def on_load_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        self.seen, self._cpu_seconds = checkpoint["seen"], checkpoint["cpu_seconds"]

    def on_after_backward(self) -> None:
        self.log_dict(self.terms)

    def configure_gradient_clipping(
        self, optimizer: Any, gradient_clip_val: float | None = None, gradient_clip_algorithm: str | None = None
    ) -> None:
        weights = [weight for group in optimizer.param_groups for weight in group["params"]]
        norm = nn.utils.get_total_norm([weight.grad for weight in weights if weight.grad is not None])
        longest = gradient_clip_val or self.clip_norm
        if not self.check_is_finite(norm) and self.stop:
            optimizer.zero_grad(set_to_none=True)  # no weights move without gradients
        elif gradient_clip_algorithm == "value":
            self.clip_gradients(optimizer, longest, gradient_clip_algorithm)
        elif longest:
            nn.utils.clip_grads_with_norm_(weights, longest, norm)

    def check_is_finite(self, norm: Tensor) -> bool:
        """Check whether the gradient norm and the losses are finite.

        If any of them is not, training ends after this step.
        """
        well = bool(torch.stack([norm, *self.terms.values()]).isfinite().all())
        if not well and not self.trouble and getattr(self.trainer.precision_plugin, "scaler", None) is None:
            wrong = next((name for name, term in self.terms.items() if not term.isfinite()), None)
            what = f"{wrong} is {float(self.terms[wrong])}" if wrong else "the gradient is not finite"
            self.stop, self.trouble = Status.DIVERGED, f"step {self.global_step + 1}: {what}"
            self.trainer.should_stop = True
        return well

    def _timers(self) -> list[Timer]:
        try:
            callbacks = self.trainer.callbacks  # type: ignore[attr-defined]
        except RuntimeError:  # no Trainer is running
            return []
        return [callback for callback in callbacks if isinstance(callback, Timer)]
