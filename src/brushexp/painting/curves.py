"""Losses, quality and time of a fit: as its loggers and callbacks get them, and as metrics.json keeps them."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import torch

from brushexp.painting.metrics import psnr_of

if TYPE_CHECKING:
    from brushexp.painting.painter import Painter

LOG_SECONDS = 0.25  # at least between two points of the curves: writing one costs as much as half a step
MAX_PAIRS = 200  # (seconds, PSNR) that a run keeps

Pair = tuple[float, float]


class Anytime:
    """Pairs (seconds of optimisation, PSNR in dB as last seen), thinned so that straight lines between them say most.

    When there are more than ``most``, the one goes whose triangle with its two neighbours is smallest (Visvalingam and
    Whyatt, 1993): bends are kept, straight pieces need few pairs. The first and the last one always stay.
    """

    def __init__(self, *, most: int = MAX_PAIRS) -> None:
        self.pairs: list[Pair] = []
        self.most = most

    def add(self, seconds: float, psnr: float) -> None:
        """Add a pair later than the others, or in place of the last one if it is of the same time.

        A PSNR that is no number, because nothing was seen yet or the picture is perfect, is left out.
        """
        if not math.isfinite(psnr):
            return
        if self.pairs and seconds <= self.pairs[-1][0]:
            self.pairs.pop()
        self.pairs.append((seconds, psnr))
        if len(self.pairs) > self.most:
            sizes = [_triangle(*self.pairs[k - 1 : k + 2]) for k in range(1, len(self.pairs) - 1)]
            del self.pairs[1 + sizes.index(min(sizes))]


def _triangle(a: Pair, b: Pair, c: Pair) -> float:
    """Twice the area of the triangle of three pairs."""
    return abs((b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1]))


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
