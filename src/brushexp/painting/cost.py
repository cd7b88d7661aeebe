"""What a run will cost: seconds predicted from a few steps of the very scene, on this machine."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import torch

from brushexp.painting.painter import Painter

LONG = 10.0  # seconds: runs that a first glance finds shorter are not worth a prediction
ENOUGH = 0.5  # seconds over which steps are timed, and before that for the strokes to spread; of few strokes a fifth
GROWTH = 1.2  # by so much steps over the whole canvas get dearer later on, as strokes come to overlap more
MOST = 1.0  # seconds that a step may be expected to take if it is to be taken
SHARES = (1 / 64, 1 / 16, 1 / 4, 1.0)  # of the strokes, whose steps are timed one after another


@dataclass(frozen=True)
class Cost:
    """What a stage takes: ``begin + step * steps`` seconds."""

    step: float
    begin: float = 0.0

    def seconds(self, steps: int) -> float:
        """Of so many steps."""
        return self.begin + self.step * steps

    def steps(self, seconds: float) -> int:
        """That fit into so many seconds."""
        return max(0, round((seconds - self.begin) / max(self.step, 1e-9)))


@dataclass(frozen=True)
class Line:
    """Seconds that depend on the number of strokes: ``fixed + each * strokes``."""

    fixed: float
    each: float

    def __call__(self, strokes: float) -> float:
        return self.fixed + self.each * strokes

    @staticmethod
    def through(points: Sequence[tuple[float, float]]) -> Line:
        """Through the last two (strokes, seconds), neither part below 0; a single one is proportional to strokes."""
        if len(points) == 1:
            ((n, seconds),) = points
            return Line(0.0, seconds / max(n, 1))
        (few, short), (many, long) = points[-2:]
        each = min(max(long - short, 0.0) / (many - few), long / many)
        return Line(long - each * many, each)


def calibrate(painter: Painter) -> list[Cost]:
    """Time steps of each stage on a copy of the painting, about a second for each; the painting stays as it is.

    The pixels and the overlap of the strokes are those of the scene, so that of the usual model,
    a + b pixels + c (pairs of strokes and tiles), only the part that strokes have in it needs to be known. It is read
    from steps over a part of the strokes, where there will be others than at the start (`Density.mean_share`) or where
    a step over all of them would take too long: a network may take minutes. Partial updates look at as many strokes
    whatever there are; of those all steps are the same. Over the whole canvas steps get dearer while strokes spread
    over each other, most of all in the first fifty; `GROWTH` stands for what a calibration does not live to see.
    """
    state = torch.get_rng_state()
    try:
        return [_stage_cost(painter, stage) for stage in range(len(painter.ends))]
    finally:
        torch.set_rng_state(state)


def predict(painter: Painter, *, long: float = LONG) -> float | None:
    """Seconds that the steps of a painting will take; None if it is clear at once that they are few.

    Args:
        painter: before its first step, rehearsed.
        long: from how many seconds on a prediction is made.
    """
    steps = [end - begin for begin, end in pairwise([0, *painter.ends])]
    before = painter.clock()
    painter.rehearse(update=False)
    alike = len({id(stage.renderer) for stage in painter.parts.stages}) == 1
    if alike and (painter.clock() - before) * painter.steps < long:
        return None
    seconds = sum(cost.seconds(n) for cost, n in zip(calibrate(painter), steps, strict=True) if n)
    return seconds if seconds >= long else None


def in_words(seconds: float) -> str:
    """``about 40 s``, with as many digits as a prediction has."""
    if seconds < 90:
        return f"about {_rounded(seconds):g} s"
    if seconds < 90 * 60:
        return f"about {_rounded(seconds / 60):g} min"
    return f"about {_rounded(seconds / 3600):g} h"


def _rounded(value: float) -> float:
    """To two digits, the second one 0 or 5 from 20 on: 7.3, 18, 45."""
    step = 10.0 ** (math.floor(math.log10(max(value, 1e-3))) - 1)
    return round(value / (5 * step)) * 5 * step if value >= 20 else round(value / step) * step


def _stage_cost(painter: Painter, stage: int) -> Cost:
    cost, share = _full_cost(painter, stage), 0 if stage else painter.coarse
    if not share:
        return cost
    small = _step(painter.trial(0, coarse=True), 1.0)
    return Cost(share * small + (1 - share) * cost.step, cost.begin)


def _full_cost(painter: Painter, stage: int) -> Cost:
    """What a stage takes if all of its steps look at the picture in its own size."""
    n = len(painter.catalogue)
    trial = painter.trial(stage)
    if trial.looks_at_parts:
        step = _step(trial, 1.0)
        if not stage:
            return Cost(step)  # the whole picture was drawn at the rehearsal
        return Cost(step, _line(n, SHARES, lambda share: _picture(painter.trial(stage, share)))(n))
    growth = painter.parts.density.mean_share if painter.budget > n else 1.0
    shares = (1.0,) if not stage and growth == 1 else SHARES  # the first stage was rehearsed with all strokes
    seconds_of = _line(n, shares, lambda share: _step(painter.trial(stage, share), share))
    return Cost(seconds_of(growth * max(n, 1)) * (1 if stage else GROWTH))  # a later stage finds strokes that are done


def _line(n: int, shares: Sequence[float], seconds_of: Callable[[float], float]) -> Line:
    """Seconds by number of strokes, measured with growing shares of ``n``, two at least, until it would take long."""
    points: list[tuple[float, float]] = []
    for share in shares:
        strokes = max(1, round(share * n))
        if points and strokes == points[-1][0]:
            continue
        if len(points) > 1 and points[-1][1] * strokes / points[-1][0] > MOST:
            break
        points.append((strokes, seconds_of(share)))
    return Line.through(points)


def _step(trial: Painter, share: float) -> float:
    """Seconds of a step, after one that loads something or is the first of its size, and those that move strokes most.

    A network's first batch of a new size is slow.
    """
    optimizer = trial.configure_optimizers()
    trial.advance(optimizer, ENOUGH if share == 1 else 0)
    begin, before = trial.clock(), trial.step
    trial.advance(optimizer, ENOUGH * max(share, 0.2))
    return (trial.clock() - begin) / (trial.step - before)


def _picture(trial: Painter) -> float:
    """Seconds in which all strokes are drawn."""
    begin = trial.clock()
    trial.picture()
    return trial.clock() - begin
