"""Losses, quality and time of a fit: as its loggers and callbacks get them, and as metrics.json keeps them."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import torch
from torch import Tensor
from torch.utils._pytree import tree_map_only

from brushexp.pictures.similarity import psnr_of
from brushexp.system.callbacks import publish_values

if TYPE_CHECKING:
    from brushexp.painting.painting_module import PaintingModule

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


class Lazy(Tensor):
    """A number that is computed when somebody looks at it, and then each time."""

    compute: Callable[[], float]

    @classmethod
    def __torch_function__(cls, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        args, kwargs = tree_map_only(cls, lambda number: _number(number.compute()), (args, kwargs or {}))
        return func(*args, **kwargs)


class Curves:
    """Losses, PSNR and seconds of a painter: of each step for callbacks, now and then for loggers.

    Loggers get the first step, the last, and some between, at most four a second. PSNR is that of the picture which the
    step has looked at, so before its strokes moved.
    """

    def __init__(self) -> None:
        self.next_seconds = 0.0  # of the painter's time, when the next point is due
        self.values: dict[str, Tensor] = {}  # of the last step

    def begin(self, painter: PaintingModule) -> None:
        """A fit begins."""
        self.next_seconds = 0.0
        if not painter.anytime.pairs:
            painter.anytime.add(0.0, psnr_of(painter.picture.error))

    def step_taken(self, painter: PaintingModule) -> None:
        """Before callbacks hear of a step: let them see its values."""
        losses, error = painter.components.losses, painter.picture.error_now()
        psnr = torch.empty(()).as_subclass(Lazy)
        psnr.compute = lambda: psnr_of(error())
        self.values = {f"loss/{losses[name].label or name}": term for name, term in painter.terms.items()}
        self.values |= {"psnr": psnr, "seconds": _number(painter.schedule.seconds)}
        publish_values(painter, self.values)

    def write(self, painter: PaintingModule, *, is_last: bool) -> None:
        """After a step: give its values to the loggers if they are due."""
        trainer, seconds = painter.trainer, painter.schedule.seconds
        every = trainer.log_every_n_steps if self.next_seconds else 1  # type: ignore[attr-defined]
        if not is_last and (seconds < self.next_seconds or trainer.global_step % every):
            return
        self.next_seconds = seconds + LOG_SECONDS
        values = {name: float(value) for name, value in self.values.items()}
        painter.anytime.add(values["seconds"], values["psnr"])
        for logger in painter.loggers:
            logger.log_metrics(values, painter.schedule.step - 1)  # Lightning numbers steps from 0


def _number(value: float) -> Tensor:
    return torch.tensor(value, dtype=torch.float64)
