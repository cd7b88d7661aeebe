"""Train a network with a schedule of its learning rate, clipped gradients, and curves."""

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

WARMUP_STEPS, WARMUP_SHARE = 200, 0.1  # over which the rate rises; of a short training a share of the steps
FINAL_RATE = 0.01  # share of the highest learning rate at the end


class NetworkModule(L.LightningModule):
    """Trains a network until the first limit of its Trainer: ``max_steps``, ``max_epochs`` or a `Timer`."""

    title = "training"  # for the progress bar
    clip_norm: float | None = None  # longest gradient, unless the Trainer has another

    def __init__(self) -> None:
        super().__init__()
        self.stop: Status | None = None  # why training ends before its limit
        self.trouble = ""  # how the weights would have become no numbers; they stay as they were before that step
        self.terms: dict[str, Tensor] = {}  # the losses of the last step
        self.seen = 0  # strokes that were looked at in training, those before an interruption included
        self._cpu_seconds = 0.0  # in fits that are over
        self._since: float | None = None  # the clock of CPU time at the beginning of the present fit
        self.figures: dict[str, float] = {}  # figures of the last validation
        self.validated = -1  # the step at which they were measured

    @property
    def progress(self) -> float:
        # Trainer.estimated_stepping_batches would set up the data before a checkpoint's state of them is there.
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
        """Wall time of the fit so far, that before an interruption included; 0 without a `Timer`."""
        return max((timer.time_elapsed() for timer in self._timers()), default=0.0)

    @property
    def cpu_seconds(self) -> float:
        """CPU time of all threads in the fit so far, that before an interruption included."""
        return self._cpu_seconds + (0.0 if self._since is None else time.process_time() - self._since)

    def state_line(self) -> str:
        raise NotImplementedError

    def schedule(self, optimizer: Optimizer) -> LambdaLR:
        """Raise the learning rate linearly, then lower it by half a cosine to `FINAL_RATE` of it at the end."""

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
        if not self.goes_well(norm) and self.stop:
            optimizer.zero_grad(set_to_none=True)  # nothing moves without a gradient
        elif gradient_clip_algorithm == "value":
            self.clip_gradients(optimizer, longest, gradient_clip_algorithm)
        elif longest:
            nn.utils.clip_grads_with_norm_(weights, longest, norm)

    def goes_well(self, norm: Tensor) -> bool:
        """Test whether a gradient's norm and the losses are finite; if not, training ends with this step."""
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
        except RuntimeError:  # no Trainer has begun
            return []
        return [callback for callback in callbacks if isinstance(callback, Timer)]
