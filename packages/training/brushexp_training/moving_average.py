"""Average the weights of a training, which makes a better network than the last of them."""

from typing import Any

import lightning as L
from lightning.pytorch.callbacks import WeightAveraging
from torch.optim.swa_utils import get_ema_multi_avg_fn


class MovingAverage(WeightAveraging):
    """Validate an exponential moving average of the weights, which replaces them at the end or at a failure.

    At each step it keeps ``decay`` < 1 of the old weights; early averages, mostly of random weights, forget faster.
    """

    def __init__(self, decay: float) -> None:
        def average(averages: Any, weights: Any, count: Any) -> None:
            warm_decay = min(decay, (1 + int(count)) / (10 + int(count)))
            get_ema_multi_avg_fn(warm_decay)(averages, weights, count)

        super().__init__(multi_avg_fn=average)
        self.in_place = False  # whether the average has replaced the weights for a validation

    def on_validation_epoch_start(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        super().on_validation_epoch_start(trainer, pl_module)
        self.in_place = True

    def on_validation_epoch_end(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        super().on_validation_epoch_end(trainer, pl_module)
        self.in_place = False

    def on_exception(self, trainer: L.Trainer, pl_module: L.LightningModule, exception: BaseException) -> None:
        if self._average_model is not None and not self.in_place:
            self._copy_average_to_current(pl_module)
        self._average_model = None  # no exchange from here on
