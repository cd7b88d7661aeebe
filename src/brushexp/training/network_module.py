"""What the LightningModules of renderer and discriminator share: progress, learning rate, curves."""

import math
from collections.abc import Mapping

import lightning as L
from lightning.pytorch.callbacks import Timer
from torch import Tensor
from torch.optim import Optimizer
from torch.optim.lr_scheduler import LambdaLR

WARMUP_STEPS, WARMUP_SHARE = 200, 0.1  # over which the rate rises; of a short training a share of the steps
FINAL_RATE = 0.01  # of the highest learning rate, at the end


class NetworkModule(L.LightningModule):
    """A network that is trained until the first limit of its Trainer: ``max_steps``, ``max_epochs`` or a `Timer`."""

    title = "training"  # for the progress bar

    def __init__(self) -> None:
        super().__init__()
        self.stop = ""  # why training ends before its limit (`system.callbacks`)
        self.figures: dict[str, float] = {}  # of the last validation
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
            left, spent = timer.time_remaining(), timer.time_elapsed()
            shares += [] if left is None else [spent / max(spent + left, 1e-9)]
        return min(1.0, max(shares))

    @property
    def seconds(self) -> float:
        """Wall time of the fit so far, that before an interruption included; 0 without a `Timer`."""
        return max((timer.time_elapsed() for timer in self._timers()), default=0.0)

    def state_line(self) -> str:
        raise NotImplementedError

    def schedule(self, optimizer: Optimizer) -> LambdaLR:
        """A linear rise of the learning rate, then half a cosine down to `FINAL_RATE` of it at the end of training."""

        def factor(_: int) -> float:
            share, rise = self.progress, (self.global_step + 1) / WARMUP_STEPS
            cosine = FINAL_RATE + (1 - FINAL_RATE) * 0.5 * (1 + math.cos(math.pi * share))
            return cosine * min(1.0, max(rise, share / WARMUP_SHARE))

        return LambdaLR(optimizer, factor)

    def note(self, curves: Mapping[str, Tensor]) -> bool:
        """Log values of a training step and return True, if it is one at which the Trainer writes the curves."""
        due = not self.global_step or (self.global_step + 1) % max(1, self.trainer.log_every_n_steps) == 0  # type: ignore[attr-defined]
        if due:
            self.log_dict(dict(curves))
        return due

    def _timers(self) -> list[Timer]:
        callbacks = self.trainer.callbacks if self._trainer is not None else []  # type: ignore[attr-defined]
        return [found for found in callbacks if isinstance(found, Timer)]
