"""Code the strokes of a painting: how coarsely each number may be rounded, and what is lost.

- The sensitivity of the picture to each number is estimated by its gradient of random pictures (Hutchinson 1989).
- A column has a step, and a stroke two octaves of coarseness, of shape and paint, such that rounding any number costs
  the picture about as much: the allocation that needs the fewest bits for an error (reverse water-filling).
- Strokes that do not overlap are exchanged, so that neighbours follow each other.
- Columns are rounded one group after another; before each, a few steps of gradient descent let the columns that are
  not yet rounded make up for those that are.
- All steps are scaled until the picture has the error that is allowed.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from brushexp.contracts.families import ExportJob
from brushexp.contracts.strokes import Strokes
from brushexp_coding.file import file_of
from brushexp_coding.ordering import neighbouring_order
from brushexp_coding.rounding import (
    DRIFT,
    OF_WINDOWS,
    Column,
    Rounded,
    facing_right,
    is_paint,
    round_values,
    rung_near,
    strokes_of,
    values_of,
)

SIDE = 1024  # pixels of the longer side, at most, of the picture in which errors are measured
PROBES = 12  # random pictures
FINEST, COARSEST = -8, 3  # octaves of coarseness; beyond, strokes that are hardly seen would come to be seen
UNSEEN = 2.0**-24  # sensitivity of a number that is not seen
TRIALS, SLOW_TRIALS, MOST_TRIALS = 6, 3, 30  # of the scale of all steps: without descent, with it, of both at most
BOLDEST = 4.0  # factor by which a trial's scale differs from that before
REFINED = 2.5  # error of rounding at once over that of rounding in stages, about
ENOUGH, AIM = 0.8, 0.92  # shares of the error that is allowed
RATE = 0.1  # of the descent (Adam), in steps of rounding
SAME = 1e-8  # mean squared error below which two pictures are the same
STAGES = (  # columns that are rounded together, the first ones first
    (*OF_WINDOWS, Column.CHORD_X, Column.CHORD_Y),
    (Column.BEND_X, Column.BEND_Y),
    (Column.MIDDLE_X, Column.MIDDLE_Y, Column.THICKNESS),
    (Column.SOFTNESS, Column.OPACITY, Column.WIDENING),
    DRIFT,
    (Column.RED, Column.GREEN, Column.BLUE),
)


@dataclass(frozen=True)
class Coded:
    """A painting as a file, and what was made of it."""

    data: bytes  # the file
    rounded: Rounded
    picture: Tensor  # (3, h, w) of the decoded strokes; its longer side is `SIDE` pixels at most
    loss: float  # by how much the mean squared error against the goal has grown


def code(job: ExportJob, *, allowed: float, goal: Tensor | None = None, steps: int = 60) -> Coded:
    """Code the strokes of a job so coarsely that the mean squared error of the picture grows by ``allowed`` at most.

    Args:
        job: painting; its light and paper are not looked at.
        allowed: mean square of pixels in [0, 1], more than 0.
        goal: (3, h, w) picture that the strokes stand for; None for their own.
        steps: number of gradient steps in all; 0 rounds all columns at once.
    """
    canvas = Canvas(job)
    strokes = job.strokes[job.bottom_up].map(lambda value: value.detach().cpu().float())
    with torch.no_grad():
        own = canvas.draw(strokes)
    goal = own if goal is None else goal
    order = torch.from_numpy(neighbouring_order(strokes, job.size, job.renderer))
    rounding = _Rounding(canvas, template_of(canvas, strokes[order], own), goal)
    before = mean_square(own - goal)

    def loss_of(trial: Rounded) -> float:
        return max(SAME, rounding.error(trial) - before)

    scale, usual = rounding.scale_for(allowed), REFINED if steps else 1.0
    rounded, scale = _coarsest(lambda scale: rounding.at(scale, 0), loss_of, usual * allowed, scale, TRIALS)
    if steps:
        rounded, scale = _coarsest(lambda scale: rounding.at(scale, steps), loss_of, allowed, scale, SLOW_TRIALS)
    with torch.no_grad():
        picture = canvas.draw(rounded.strokes())
    return Coded(file_of(rounded, job.saved), rounded, picture, mean_square(picture - goal) - before)


def _coarsest(
    at: Callable[[float], Rounded], loss_of: Callable[[Rounded], float], allowed: float, scale: float, trials: int
) -> tuple[Rounded, float]:
    """Find about the largest scale at which rounding costs no more than is allowed.

    After ``trials`` the coarsest that was fine enough is taken; without one, the search goes on with finer ones.
    """
    best: tuple[Rounded, float] | None = None
    too_coarse = np.inf
    for trial in range(MOST_TRIALS):
        rounded = at(scale)
        share = loss_of(rounded) / allowed
        if share > 1:
            too_coarse = min(too_coarse, scale)
        elif best is None or scale > best[1]:
            best = rounded, scale
        if ENOUGH <= share <= 1 or not len(rounded) or (best is not None and trial + 1 >= trials):
            break
        fine = 0.0 if best is None else best[1]
        proposed = scale * min(max((AIM / share) ** 0.5, 1 / BOLDEST), BOLDEST)
        scale = proposed if fine < proposed < too_coarse else (max(fine, too_coarse / BOLDEST) * too_coarse) ** 0.5
    return (rounded, scale) if best is None else best


def mean_square(difference: Tensor) -> float:
    """Compute the mean square in double precision."""
    return float(difference.detach().double().square().mean())


class Canvas:
    """Draws strokes of a job in its size, or in `SIDE` pixels, with gradient."""

    def __init__(self, job: ExportJob) -> None:
        self.job, self.size = job, job.at_most(SIDE).size
        self.zoom = max(self.size) / max(job.size)

    def draw(self, strokes: Strokes) -> Tensor:
        """Draw strokes, the bottom one first: a picture (3, h, w)."""
        top_down = torch.arange(len(strokes)).flip(0)
        layers = self.job.renderer(strokes.moved(zoom=self.zoom))
        return self.job.compositor(layers, top_down, self.size, self.job.saved.background).image


@dataclass(frozen=True)
class Template:
    """What of N strokes is coded, the bottom one first."""

    strokes: Strokes
    windows: bool = False  # whether their windows are
    brushes: bool = False  # whether their brushes are
    turned: bool = False  # whether they are turned, so that all lead to the right

    def values(self) -> Tensor:
        """Compute the values (N, C) of the columns, float64."""
        values = values_of(self.strokes, windows=self.windows)
        return facing_right(values) if self.turned else values

    def made_of(self, values: Tensor) -> Strokes:
        """Make strokes of other values (N, C), float64, as they come out of a file."""
        strokes = strokes_of(values, windows=self.windows).map(lambda value: value.float())
        return replace(strokes, brush=self.strokes.brush) if self.brushes else strokes


def template_of(canvas: Canvas, strokes: Strokes, own: Tensor) -> Template:
    """Find the least that draws the same picture: many renderers draw neither windows nor brushes."""
    least_first = (
        Template(strokes, turned=True),
        Template(strokes),
        Template(strokes, brushes=True),
        Template(strokes, windows=True),
    )
    with torch.no_grad():
        for template in least_first:
            if mean_square(canvas.draw(template.made_of(template.values())) - own) < SAME:
                return template
    return Template(strokes, windows=True, brushes=True)


class _Rounding:
    """Rounds the strokes of a template at several scales of all steps."""

    def __init__(self, canvas: Canvas, template: Template, goal: Tensor) -> None:
        self._canvas, self._template, self._goal, self._values = canvas, template, goal, template.values()
        count, columns = self._values.shape
        self._coarseness, self._octaves = np.zeros((count, 2), np.int64), np.zeros(columns)
        if count:
            self._allocate(-np.log2(self._sensitivity().numpy().clip(UNSEEN)))

    def scale_for(self, error: float) -> float:
        """Compute the scale at which rounding at once should cost so much, were the picture linear in the numbers."""
        return (12 * error / max(1, self._values.numel())) ** 0.5

    def error(self, rounded: Rounded) -> float:
        """Compute the mean squared error against the goal."""
        with torch.no_grad():
            return mean_square(self._canvas.draw(rounded.strokes()) - self._goal)

    def at(self, scale: float, steps: int) -> Rounded:
        """Round at a scale, group by group, with ``steps`` of gradient descent in all."""
        rungs = np.array([rung_near(scale * 2.0**octave) for octave in self._octaves])
        brushes = self._template.strokes.brush.numpy() if self._template.brushes else None
        rounded = Rounded(
            np.zeros(self._values.shape, np.int64), self._coarseness, rungs, self._template.windows, brushes
        )
        values = self._values
        for number, stage in enumerate(STAGES[:-1] if steps else ()):
            done = [column for group in STAGES[: number + 1] for column in group if column < values.shape[1]]
            fixed = torch.zeros(values.shape[1], dtype=torch.bool)
            fixed[done] = True
            numbers = torch.from_numpy(round_values(values, rounded.steps))
            values = torch.where(fixed, numbers * torch.from_numpy(rounded.steps), values)
            if any(column < values.shape[1] for column in stage):
                values = self._descended(values, fixed, rounded.steps, steps // (len(STAGES) - 1))
        return replace(rounded, numbers=round_values(values, rounded.steps))

    def _descended(self, values: Tensor, fixed: Tensor, steps: np.ndarray, count: int) -> Tensor:
        """Move the values of columns that are not ``fixed`` (C,) towards the goal."""
        unit = torch.from_numpy(steps)
        moving = (values / unit).requires_grad_()
        optimizer = torch.optim.Adam([moving], lr=RATE, betas=(0.9, 0.99))
        schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, max(1, count))
        for _ in range(count):
            picture = self._canvas.draw(self._template.made_of(torch.where(fixed, values, moving * unit)))
            optimizer.zero_grad()
            (picture - self._goal).square().sum().backward()
            optimizer.step()
            schedule.step()
        return torch.where(fixed, values, moving.detach().nan_to_num(0.0) * unit)

    def _sensitivity(self) -> Tensor:
        """Estimate (N, C) by how much a number changes the picture: root of the mean square of all its pixels."""
        values = self._values.clone().requires_grad_()
        picture = self._canvas.draw(self._template.made_of(values))
        random, squares = torch.Generator().manual_seed(0), torch.zeros_like(self._values)
        for probe in range(PROBES):
            noise = torch.randn(picture.shape, generator=random)
            (gradient,) = torch.autograd.grad((picture * noise).sum(), values, retain_graph=probe < PROBES - 1)
            squares += gradient.nan_to_num(0.0).square() / PROBES
        return (squares / picture.numel()).sqrt()

    def _allocate(self, wanted: np.ndarray) -> None:
        """Split the octaves (N, C) of the steps that are wanted into those of strokes and those of columns."""
        rows = (wanted < -np.log2(UNSEEN)).all(1)
        rows = rows if rows.any() else ~rows
        paint = is_paint(wanted.shape[1])
        for kind in (0, 1):
            columns = np.nonzero(paint == bool(kind))[0]
            mean = wanted[:, columns].mean(1)
            self._coarseness[:, kind] = np.rint(mean - np.median(mean[rows])).clip(FINEST, COARSEST)
            own = wanted[:, columns] - self._coarseness[:, kind, None]
            self._octaves[columns] = own[rows].mean(0)
        for triple in ((Column.RED, Column.GREEN, Column.BLUE), DRIFT):  # which are coded as luma and chroma
            self._octaves[list(triple)] = self._octaves[list(triple)].mean()
