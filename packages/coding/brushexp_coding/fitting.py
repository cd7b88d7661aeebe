"""Choose how coarsely to round each number of a painting's strokes, and encode the strokes.

- The picture's sensitivity to each number is estimated from gradients of random projections (Hutchinson, 1989).
- Each column has a step size, and each stroke has two coarseness values in octaves, for its shape and for its paint.
  Both are chosen so that rounding any number adds about the same error, because a given total error then needs the
  fewest bits (reverse water-filling).
- Strokes that do not overlap are reordered, so that consecutive strokes are neighbours.
- Columns are rounded group by group. Before each group, a few steps of gradient descent let the remaining columns
  compensate for the columns that are already rounded.
- All step sizes are scaled together until the picture has the allowed error, or the file has the allowed size.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from brushexp.contracts import UserError
from brushexp.contracts.families import ExportJob
from brushexp.contracts.strokes import Strokes
from brushexp_coding.file import file_of
from brushexp_coding.ordering import neighbouring_order
from brushexp_coding.rounding import (
    DRIFT,
    WINDOW_COLUMNS,
    Column,
    Rounded,
    is_paint,
    orient_right,
    round_values,
    rung_near,
    strokes_of,
    values_of,
)
from brushexp_coding.search import BOLDEST, coarsest, finest
from brushexp_coding.sizes import size_text

SIDE = 1024  # maximum longer side in pixels of the picture on which errors are measured
PROBES = 12  # number of random projections
FINEST, COARSEST = -8, 3  # octaves of coarseness; with coarser rounding, barely visible strokes would become visible
UNSEEN = 2.0**-24  # sensitivity of a number that has no visible effect
TRIALS, SLOW_TRIALS = 6, 3  # number of scales tried without and with gradient descent
REFINED = 2.5  # approximate ratio of the errors of rounding at once and of rounding in stages
LEAST_ERROR, MOST_ERROR = 1e-7, 1e-2  # mean squared errors of the finest and the coarsest sensible rounding
RATE = 0.1  # learning rate of the descent (Adam), in rounding steps
SAME = 1e-8  # mean squared error below which two pictures count as equal
STAGES = (  # groups of columns that are rounded together, in order
    (*WINDOW_COLUMNS, Column.CHORD_X, Column.CHORD_Y),
    (Column.BEND_X, Column.BEND_Y),
    (Column.MIDDLE_X, Column.MIDDLE_Y, Column.THICKNESS),
    (Column.SOFTNESS, Column.OPACITY, Column.WIDENING),
    DRIFT,
    (Column.RED, Column.GREEN, Column.BLUE),
)


@dataclass(frozen=True)
class Coded:
    """A painting encoded as a file, with the rounded strokes, the decoded picture and the loss."""

    data: bytes  # the file
    rounded: Rounded
    picture: Tensor  # (3, h, w), drawn from the decoded strokes; its longer side has at most `SIDE` pixels
    loss: float  # increase of the mean squared error against the goal


def code(job: ExportJob, *, allowed: float, goal: Tensor | None = None, steps: int = 60) -> Coded:
    """Encode the strokes of a job as coarsely as possible while the picture's error grows by at most ``allowed``.

    Args:
        job: painting; its light and paper are ignored.
        allowed: maximum increase in mean squared error, greater than 0, for pixels in [0, 1].
        goal: picture (3, h, w) that the strokes should approximate; None for the picture that they draw.
        steps: total number of gradient steps; 0 rounds all columns at once.
    """
    fit = _Fit(job, goal)
    return fit.encode(fit.coarsest(allowed, steps))


def code_within(job: ExportJob, *, size: int, goal: Tensor | None = None, steps: int = 60, option: str) -> Coded:
    """Encode the strokes of a job as finely as ``size`` bytes allow; for the other arguments, see `code`.

    Raises UserError, with a message that ``option`` is too small, if the coarsest rounding needs more bytes.
    """
    fit = _Fit(job, goal)
    coded = fit.encode(fit.finest(size, steps))
    if len(coded.data) <= size and coded.loss <= MOST_ERROR:
        return coded
    coded = fit.encode(fit.coarsest(MOST_ERROR, steps))
    if len(coded.data) <= size:
        return coded
    empty = len(fit.encode(Rounded.none()).data)
    count = len(job.strokes)
    fitting = int(count * (size - empty) / max(1, len(coded.data) - empty))
    cure = f"type {option}={size_text(len(coded.data))}"
    cure += f", or paint about {fitting} strokes" if fitting > 0 else ""
    raise UserError(f"{option}={size_text(size)} is too small for {count} strokes; {cure}")


class _Fit:
    """Searches for the best rounding of a job's strokes."""

    def __init__(self, job: ExportJob, goal: Tensor | None) -> None:
        self._canvas, self._saved = Canvas(job), job.saved
        strokes = job.strokes[job.bottom_up].map(lambda value: value.detach().cpu().float())
        with torch.no_grad():
            own = self._canvas.draw(strokes)
        self._goal = own if goal is None else goal
        order = torch.from_numpy(neighbouring_order(strokes, job.size, job.renderer))
        self._rounding = _Rounding(self._canvas, template_of(self._canvas, strokes[order], own), self._goal)
        self._before = mean_square(own - self._goal)

    def coarsest(self, allowed: float, steps: int) -> Rounded:
        """Round as coarsely as the allowed error permits."""
        scale, usual = self._rounding.scale_for(allowed), REFINED if steps else 1.0
        rounded, scale = coarsest(self._at(0), self._loss_of, usual * allowed, scale, TRIALS)
        if steps:
            rounded, scale = coarsest(self._at(steps), self._loss_of, allowed, scale, SLOW_TRIALS)
        return rounded

    def finest(self, size: int, steps: int) -> Rounded:
        """Round as finely as ``size`` bytes allow, or at the coarsest scale if nothing fits."""
        limits = self._rounding.scale_for(LEAST_ERROR), BOLDEST * self._rounding.scale_for(MOST_ERROR)
        at_once = finest(self._at(0), self._size_of, size, limits[1] / BOLDEST, TRIALS, limits=limits)
        if at_once is None or not steps:
            return self._rounding.at(limits[1], 0) if at_once is None else at_once[0]
        in_stages = finest(self._at(steps), self._size_of, size, at_once[1], SLOW_TRIALS, limits=limits)
        return min((trial[0] for trial in (at_once, in_stages) if trial is not None), key=self._loss_of)

    def encode(self, rounded: Rounded) -> Coded:
        """Encode rounded strokes, draw them, and compute the loss."""
        with torch.no_grad():
            picture = self._canvas.draw(rounded.strokes())
        return Coded(file_of(rounded, self._saved), rounded, picture, mean_square(picture - self._goal) - self._before)

    def _at(self, steps: int) -> Callable[[float], Rounded]:
        return lambda scale: self._rounding.at(scale, steps)

    def _loss_of(self, trial: Rounded) -> float:
        return max(SAME, self._rounding.error(trial) - self._before)

    def _size_of(self, trial: Rounded) -> int:
        return len(file_of(trial, self._saved))


def mean_square(difference: Tensor) -> float:
    """Compute the mean square of differences in double precision."""
    return float(difference.detach().double().square().mean())


class Canvas:
    """Draws strokes differentiably at the size of a job, with at most `SIDE` pixels on the longer side."""

    def __init__(self, job: ExportJob) -> None:
        self.job, self.size = job, job.at_most(SIDE).size
        self.zoom = max(self.size) / max(job.size)

    def draw(self, strokes: Strokes) -> Tensor:
        """Draw strokes, ordered bottom to top, as a picture (3, h, w)."""
        top_down = torch.arange(len(strokes)).flip(0)
        layers = self.job.renderer(strokes.moved(zoom=self.zoom))
        return self.job.compositor(layers, top_down, self.size, self.job.saved.background).image


@dataclass(frozen=True)
class Template:
    """N strokes, bottom to top, and flags for the properties that are coded."""

    strokes: Strokes
    windows: bool = False  # whether windows are coded
    brushes: bool = False  # whether brushes are coded
    turned: bool = False  # whether strokes are reversed where needed, so that all lead to the right

    def values(self) -> Tensor:
        """Compute the values (N, C) of the columns, float64."""
        values = values_of(self.strokes, windows=self.windows)
        return orient_right(values) if self.turned else values

    def make_strokes(self, values: Tensor) -> Strokes:
        """Make strokes from values (N, C), float64, as the decoder does."""
        strokes = strokes_of(values, windows=self.windows).map(lambda value: value.float())
        return replace(strokes, brush=self.strokes.brush) if self.brushes else strokes


def template_of(canvas: Canvas, strokes: Strokes, own: Tensor) -> Template:
    """Find the smallest template that draws the same picture; many renderers ignore windows and brushes."""
    least_first = (
        Template(strokes, turned=True),
        Template(strokes),
        Template(strokes, brushes=True),
        Template(strokes, windows=True),
    )
    with torch.no_grad():
        for template in least_first:
            if mean_square(canvas.draw(template.make_strokes(template.values())) - own) < SAME:
                return template
    return Template(strokes, windows=True, brushes=True)


class _Rounding:
    """Rounds the strokes of a template; one scale multiplies all step sizes."""

    def __init__(self, canvas: Canvas, template: Template, goal: Tensor) -> None:
        self._canvas, self._template, self._goal, self._values = canvas, template, goal, template.values()
        count, columns = self._values.shape
        self._coarseness, self._octaves = np.zeros((count, 2), np.int64), np.zeros(columns)
        if count:
            self._allocate(-np.log2(self._sensitivity().numpy().clip(UNSEEN)))

    def scale_for(self, error: float) -> float:
        """Estimate the scale at which rounding adds a given error, if the picture is linear in the numbers."""
        return (12 * error / max(1, self._values.numel())) ** 0.5

    def error(self, rounded: Rounded) -> float:
        """Compute the mean squared error between the drawn strokes and the goal."""
        with torch.no_grad():
            return mean_square(self._canvas.draw(rounded.strokes()) - self._goal)

    def at(self, scale: float, steps: int) -> Rounded:
        """Round group by group at a given scale, with ``steps`` steps of gradient descent in total."""
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
                values = self._descend(values, fixed, rounded.steps, steps // (len(STAGES) - 1))
        return replace(rounded, numbers=round_values(values, rounded.steps))

    def _descend(self, values: Tensor, fixed: Tensor, steps: np.ndarray, count: int) -> Tensor:
        """Optimise the columns that are not ``fixed`` (C,), so that the picture approaches the goal."""
        unit = torch.from_numpy(steps)
        moving = (values / unit).requires_grad_()
        optimizer = torch.optim.Adam([moving], lr=RATE, betas=(0.9, 0.99))
        schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, max(1, count))
        for _ in range(count):
            picture = self._canvas.draw(self._template.make_strokes(torch.where(fixed, values, moving * unit)))
            optimizer.zero_grad()
            (picture - self._goal).square().sum().backward()
            optimizer.step()
            schedule.step()
        return torch.where(fixed, values, moving.detach().nan_to_num(0.0) * unit)

    def _sensitivity(self) -> Tensor:
        """Estimate the RMS change (N, C) of the picture, over pixels and channels, per unit change in each number."""
        values = self._values.clone().requires_grad_()
        picture = self._canvas.draw(self._template.make_strokes(values))
        random, squares = torch.Generator().manual_seed(0), torch.zeros_like(self._values)
        for probe in range(PROBES):
            noise = torch.randn(picture.shape, generator=random)
            (gradient,) = torch.autograd.grad((picture * noise).sum(), values, retain_graph=probe < PROBES - 1)
            squares += gradient.nan_to_num(0.0).square() / PROBES
        return (squares / picture.numel()).sqrt()

    def _allocate(self, wanted: np.ndarray) -> None:
        """Split the desired step sizes (N, C), in octaves, into octaves for strokes and octaves for columns."""
        rows = (wanted < -np.log2(UNSEEN)).all(1)
        rows = rows if rows.any() else ~rows
        paint = is_paint(wanted.shape[1])
        for kind in (0, 1):
            columns = np.nonzero(paint == bool(kind))[0]
            mean = wanted[:, columns].mean(1)
            self._coarseness[:, kind] = np.rint(mean - np.median(mean[rows])).clip(FINEST, COARSEST)
            own = wanted[:, columns] - self._coarseness[:, kind, None]
            self._octaves[columns] = own[rows].mean(0)
        for triple in ((Column.RED, Column.GREEN, Column.BLUE), DRIFT):  # coded as luma and chroma
            self._octaves[list(triple)] = self._octaves[list(triple)].mean()
