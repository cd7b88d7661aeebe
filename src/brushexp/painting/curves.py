"""Losses, quality and time of a fit, as its loggers and callbacks get them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import torch

from brushexp.painting.metrics import psnr_of

if TYPE_CHECKING:
    from brushexp.painting.painter import Painter

LOG_SECONDS = 0.25  # at least between two points of the curves: writing one costs as much as half a step


class Curves:
    """Writes the curves of a painter, a point every few steps and at most four a second."""

    def __init__(self) -> None:
        self.next_seconds = 0.0  # of the painter's time, when the next point is due

    def begin(self, painter: Painter) -> None:
        """A fit begins: its first step is written, so that its values are known to callbacks."""
        self.next_seconds = 0.0
        if not painter.anytime.pairs:
            painter.anytime.add(0.0, psnr_of(painter.picture.error))

    def after_step(self, painter: Painter, *, is_last: bool) -> None:
        """Write a point if one is due; the last step's always is."""
        trainer, seconds = painter.trainer, painter.schedule.seconds
        every = trainer.log_every_n_steps if self.next_seconds else 1  # type: ignore[attr-defined]
        if not is_last and (seconds < self.next_seconds or trainer.global_step % every):
            return
        self.next_seconds = seconds + LOG_SECONDS
        psnr = psnr_of(painter.picture.error)
        painter.anytime.add(seconds, psnr)
        losses = painter.components.losses
        values = {f"loss/{losses[name].label or name}": float(term) for name, term in painter.terms.items()}
        values |= {"psnr": psnr, "seconds": seconds}
        # Past `log`, which costs half a millisecond at every later step, too, and writes old values again.
        trainer.callback_metrics.update({name: torch.tensor(value) for name, value in values.items()})
        for logger in painter.loggers:
            logger.log_metrics(values, painter.schedule.step)
