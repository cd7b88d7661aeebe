"""Trainings whose random start leads nowhere are begun anew."""

import logging
from collections.abc import Callable
from typing import Any

import lightning as L
import torch
from torch import Tensor, nn

from brushexp.plugins.renderer.base import window_pictures

STEPS = 200  # after which a start is judged, and again after as many if it was begun anew
MOST = 3  # new starts
ALIVE = 0.01  # share of the true variance among strokes that a network draws at least, if it learns anything

log = logging.getLogger(__name__)


class FreshStart(L.Callback):
    """Gives a network that draws every stroke alike, nothing as a rule, other random weights: those of ``fresh()``.

    An activation that has lost its slope everywhere never learns again. Its pictures are judged on the batch of the
    step, or on the next one that holds several strokes; the optimiser forgets what it knew, the schedule goes on.
    """

    def __init__(self, fresh: Callable[[], nn.Module]) -> None:
        self.fresh, self.restarts, self.lives = fresh, 0, False

    def state_dict(self) -> dict[str, Any]:
        return {"restarts": self.restarts, "lives": self.lives}

    def load_state_dict(self, state_dict: dict[str, Any]) -> None:
        self.restarts, self.lives = state_dict["restarts"], state_dict["lives"]

    def on_train_batch_end(self, trainer: L.Trainer, pl_module: Any, outputs: Any, batch: Any, batch_idx: int) -> None:
        if self.lives or self.restarts == MOST or pl_module.global_step < STEPS * (self.restarts + 1):
            return
        if not (true := variance_of(batch.images)):
            return  # a single stroke
        with torch.no_grad():
            drawn = window_pictures(pl_module.renderer, batch.parameters, pl_module.window, batch.number)
        share = variance_of(drawn) / true
        self.lives = share >= ALIVE
        if not self.lives:
            self.restarts += 1
            pl_module.renderer.load_state_dict(self.fresh().state_dict())
            for optimizer in trainer.optimizers:
                optimizer.state.clear()
            log.warning(
                "step %d: the network draws all strokes alike (%.2g %% of the variance of the true ones); "
                "begun anew with other weights, %d of %d times",
                *(pl_module.global_step, 100 * share, self.restarts, MOST),
            )


def variance_of(pictures: Tensor) -> float:
    """Compute the variance of alpha among pictures (n, 4, S, S), averaged over their pixels."""
    return float(pictures[:, 3].float().var(0, unbiased=False).mean())
