"""Trace lines through missing detail, and add strokes along them in place of the least important strokes."""

import math
from dataclasses import dataclass, fields
from typing import Annotated

import numpy as np
from torch import Tensor

from brushexp.bounds import at_least
from brushexp.pictures.structure import along_edges, sample_at, structure_tensor
from brushexp.plugins.density._rounds import CHANNELS, Rounds
from brushexp.plugins.density.base import DensificationState
from brushexp.registry import register
from brushexp.strokes.bezier import roomy_window, strokes_along
from brushexp.strokes.catalogue import Strokes

POINTS = 10  # number of steps of a line to each side of its seed
STEP = 1.2  # length of a step, in pixels of the picture on which lines of a width are sought
OLD = 0.2  # weight of the previous direction in the direction of a step
SEEDS = 0.7  # quantile of the error above which its peaks are seeds
PEAK = 3  # side in pixels of the square in which a seed has the largest error
SMOOTHING = 1.5  # pixels over which the picture's direction is averaged
WIDTHS = (0.15, 0.3, 0.6)  # widths of lines in stroke spacings
MIN_WIDTH, FINE = 1.5, 3.0  # minimum width of a line in pixels, and its width on the picture on which it is sought
SOFT = 2.0  # assumed width of a stroke's soft edge in pixels
SAMPLES = 7  # number of samples across a line
SPARE = 3  # number of seeds of each width per wanted stroke
CROWDED = 0.25  # share of a line that may lie on better lines
OPACITY = 0.95
DOT = 0.1  # length of a stroke without direction, in units of its width

Array = np.ndarray


@register("density", "traced")
@dataclass(kw_only=True)
class Traced(Rounds):
    """Starts with some of the strokes, and adds long ones where they most reduce the error.

    From each peak of the error, a line is extended in both directions along the picture's edges as far as this lowers
    the error; its colour is fitted by least squares. The gain is known before the line is painted, so one of the least
    important strokes is replaced by the line only if the gain outweighs the importance of that stroke.

    Source: Dual Parameterization (Liu et al., 2026), which traces polylines through the residual, starting at the peaks
    in its largest eighth. Unlike in the source, lines of three widths are traced at once, each in a picture downsampled
    until the line is about three pixels wide; there are more seeds, closer together; each line becomes a single
    quadratic stroke; and the number of strokes is fixed in advance.

    Args:
        start: initial fraction of the strokes, above 0 and at most 1.
        rounds: number of rounds that add and remove strokes, at least 8 steps apart.
        until: fraction of the steps after which no strokes are added or removed.
        moved: fraction of the strokes that each round may move elsewhere, 0 to 0.5.
        price: minimum ratio of a new stroke's gain to the importance of the stroke that it replaces; below 1, because
            further steps improve the new stroke.
        tolerance: root mean square error over a pixel, 0 to 1, below which no stroke is added.
        surplus: number of extra strokes before the last round, relative to the final number, 0 to 3; the least
            important strokes are then removed.
    """

    price: Annotated[float, at_least(0)] = 0.1

    def replacements(self, state: DensificationState, missing: int, weakest: Tensor) -> tuple[Strokes, int]:
        new, gain = traced_strokes(state, missing + len(weakest), CHANNELS * self.tolerance**2)
        offered = gain[missing:]  # the best lines fill missing strokes; the next ones compete with the weakest strokes
        pays = int((offered > self.price * weakest[: len(offered)]).long().cumprod(0).sum())
        return new[: missing + pays], pays


@dataclass(frozen=True)
class Lines:
    """M lines, in pixels, each with its gain: the decrease in squared error if it were painted on top."""

    points: Array  # (M, 2 * POINTS + 1, 2), on both sides of the seed
    used: Array  # (M, 2 * POINTS + 1) bool, the points that the line includes
    width: Array  # (M,)
    color: Array  # (M, 3)
    gain: Array  # (M,)


def traced_strokes(state: DensificationState, n: int, least: float) -> tuple[Strokes, Tensor]:
    """Trace at most ``n`` strokes with gains above ``least``, best first, and return them with their gains (n,).

    The gain is the decrease in squared error, summed over pixels and channels and weighted by the focus, if the stroke
    is painted on top.
    """
    target, like = state.target.cpu().numpy(), state.strokes.position
    maps, pitch = _maps(state), math.sqrt(target[0].size / max(state.budget, 1))
    widths = np.unique(np.maximum(MIN_WIDTH, np.multiply(WIDTHS, pitch)))
    found = [lines_of_width(target, maps, width, SPARE * n) for width in widths]
    lines = Lines(*(np.concatenate([getattr(part, one.name) for part in found]) for one in fields(Lines)))
    best = _apart(lines, n, least, target.shape[1:])
    curve, width, color, gain = map(
        like.new_tensor, (_curves(lines, best), lines.width[best], lines.color[best], lines.gain[best])
    )
    place = curve.mean(1)
    reach = (curve - place[:, None]).abs().amax((1, 2)) * 2 + width
    window = reach.clamp_min(roomy_window(pitch))
    return strokes_along(curve - place[:, None], width, color, OPACITY, window=window, position=place), gain


def _maps(state: DensificationState) -> Array:
    """Compute maps (10, H, W), weighted by the focus: picture P, residual R = target - P, 1, P.P, P.R and R.R."""
    image, residual = state.image.cpu().numpy(), (state.target - state.image).cpu().numpy()
    products = [(a * b).sum(0) for a, b in ((image, image), (image, residual), (residual, residual))]
    maps = np.concatenate([image, residual, np.ones_like(image[:1]), np.stack(products)])
    return maps if state.focus is None else maps * state.focus.cpu().numpy()


def lines_of_width(target: Array, maps: Array, width: float, most: int) -> Lines:
    """Find lines of ``width`` pixels through at most ``most`` peaks of the error ``maps[9]``, largest first."""
    from scipy.ndimage import maximum_filter, uniform_filter  # noqa: PLC0415  (--help does not need it)

    zoom = max(1, min(round(width / FINE), *target.shape[1:]))
    target, maps = _average_squares(target, zoom), _average_squares(maps, zoom)
    error = uniform_filter(maps[9], 3, mode="constant")
    row, column = np.nonzero((error == maximum_filter(error, PEAK)) & (error >= np.quantile(error, SEEDS)))
    worst = np.argsort(-error[row, column], kind="stable")[:most]
    seeds = np.stack([column[worst], row[worst]], 1) + 0.5
    angle = along_edges(structure_tensor(target, SMOOTHING))
    back, forth = (_trace(angle, seeds, sign) for sign in (-1, 1))
    points = np.concatenate([back[:, ::-1], seeds[:, None], forth], axis=1)
    used, color, gain = best_parts(points, maps, width / zoom, SOFT / zoom)
    return Lines(points * zoom, used, np.full(len(points), width), color, gain * zoom**2)


def _average_squares(maps: Array, zoom: int) -> Array:
    """Average maps (C, H, W) over squares; incomplete squares at the right and bottom are dropped."""
    channels, height, width = maps.shape
    rows, columns = height // zoom, width // zoom
    squares = maps[:, : rows * zoom, : columns * zoom].reshape(channels, rows, zoom, columns, zoom)
    return maps if zoom == 1 else squares.mean((2, 4))


def _trace(angle: Array, seeds: Array, sign: int) -> Array:
    """Trace points (M, ., 2) along directions (H, W), in radians, forwards or backwards from ``seeds`` (M, 2: x, y)."""
    points, place, direction = [], seeds, np.zeros_like(seeds)
    for number in range(POINTS):
        here = sample_at(angle, place[:, 0], place[:, 1])
        new = np.stack([np.cos(here), np.sin(here)], 1)
        same_way = (new * direction).sum(1, keepdims=True) >= 0 if number else sign > 0
        direction = (1 - OLD) * np.where(same_way, new, -new) + OLD * direction
        direction /= np.linalg.norm(direction, axis=1, keepdims=True)
        place = place + STEP * direction
        points.append(place)
    return np.stack(points, 1)


def best_parts(points: Array, maps: Array, width: float, soft: float) -> tuple[Array, Array, Array]:
    """Choose how far lines (M, 2 * POINTS + 1, 2) extend from their midpoints, in one direction and then the other.

    A stroke on top with colour c and coverage a lowers the squared error by the sum of 2 a (c - P).R - a^2 |c - P|^2,
    which is largest for c = sum(a^2 P + a R) / sum(a^2). The result is the set of points that each stroke includes
    (bool; its round ends reach one point farther), its colour (M, 3) and its gain (M,).
    """
    each, numbers = np.arange(len(points)), np.arange(points.shape[1])
    sums = np.pad(_moments(points, maps, width, soft).cumsum(2), ((0, 0), (0, 0), (1, 0)))  # (5, M, .)
    ahead = sums[:, :, POINTS + 2 :] - sums[:, :, POINTS, None]
    end = POINTS + 1 + _fit_colors(ahead)[1].argmax(1)
    behind = sums[:, each, end + 1, None] - sums[:, :, POINTS - 1 :: -1]
    color, gain = _fit_colors(behind)
    back = gain.argmax(1)
    begin = POINTS - 1 - back
    used = (numbers > begin[:, None]) & (numbers < end[:, None])
    return used, color[:, each, back].T, gain[each, back]


def _moments(points: Array, maps: Array, width: float, soft: float) -> Array:
    """Sum a^2 P + a R (3 channels), a^2, and a^2 P.P + 2 a P.R across each line, at each point: (5, M, points)."""
    forward = np.gradient(points, axis=1)
    across = np.stack([-forward[..., 1], forward[..., 0]], -1)
    across /= np.linalg.norm(across, axis=2, keepdims=True).clip(1e-6)
    reach = (width + soft) / 2
    offset = ((np.arange(SAMPLES) + 0.5) / SAMPLES * 2 - 1) * reach
    place = points[:, :, None] + offset[:, None] * across[:, :, None]  # (M, points, SAMPLES, 2)
    inside = ((place >= 0) & (place < np.array(maps.shape[:0:-1]))).all(-1)
    seen = sample_at(maps[:9], place[..., 0], place[..., 1])
    alpha = (OPACITY * _coverage(offset, width, soft) * inside).astype(seen.dtype)
    square, pixels = alpha**2, STEP * 2 * reach / SAMPLES
    parts = [*(square * seen[:3] + alpha * seen[3:6]), square * seen[6], square * seen[7] + 2 * alpha * seen[8]]
    return pixels * np.stack(parts).sum(3, dtype=np.float64)


def _coverage(distance: Array, width: float, soft: float) -> Array:
    """Compute a stroke's coverage at a distance from its curve, as `compositing.profile` does."""
    inner, outer = (np.clip((width / 2 + sign * np.abs(distance)) / soft, -0.5, 0.5) for sign in (-1, 1))
    total: Array = inner * (1.5 - 2 * inner**2) + outer * (1.5 - 2 * outer**2)
    return total


def _fit_colors(moments: Array) -> tuple[Array, Array]:
    """Compute the best colour (3, ...) for each stroke and the resulting gain (...) from moments (5, ...)."""
    color = (moments[:3] / moments[3].clip(1e-9)).clip(0, 1)
    return color, 2 * (color * moments[:3]).sum(0) - (color**2).sum(0) * moments[3] - moments[4]


def _apart(lines: Lines, n: int, least: float, size: tuple[int, ...]) -> Array:
    """Select at most ``n`` lines with the largest gains and little overlap."""
    taken = np.zeros(size, bool)
    chosen: list[int] = []
    x, y = (lines.points[..., axis].astype(int).clip(0, size[1 - axis] - 1) for axis in (0, 1))
    reach = (lines.width / 2).round().astype(int).clip(1)
    for k in np.argsort(-lines.gain, kind="stable")[: int((lines.gain > least).sum())]:
        if len(chosen) == n:
            break
        column, row = x[k, lines.used[k]], y[k, lines.used[k]]
        if np.count_nonzero(taken[row, column]) > CROWDED * len(row):
            continue
        chosen.append(k)
        for i, j in zip(column.tolist(), row.tolist(), strict=True):
            taken[max(0, j - reach[k]) : j + reach[k] + 1, max(0, i - reach[k]) : i + reach[k] + 1] = True
    return np.array(chosen, int)


def _curves(lines: Lines, chosen: Array) -> Array:
    """Fit quadratic curves (n, 3, 2) to the endpoints and midpoints of lines; dots become short horizontal curves."""
    points, used, each = lines.points[chosen], lines.used[chosen], np.arange(len(chosen))
    first = used.argmax(1)
    last = first + used.sum(1) - 1
    start, end = points[each, first], points[each, last]
    middle = (points[each, (first + last) // 2] + points[each, (first + last + 1) // 2]) / 2
    curves = np.stack([start, 2 * middle - (start + end) / 2, end], 1)
    short = DOT * lines.width[chosen][:, None, None] * np.array([[-0.5, 0.0], [0.0, 0.0], [0.5, 0.0]])
    return np.where((first == last)[:, None, None], middle[:, None] + short, curves)
