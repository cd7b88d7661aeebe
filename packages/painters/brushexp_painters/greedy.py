"""The ``greedy`` painter: add strokes one by one, each the best of many candidates."""
# mypy: allow-untyped-defs

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from brushexp.contracts import at_least, between, register
from brushexp.contracts.families import Painter, PaintRequest, PaintState
from brushexp.contracts.kernels import function, inline
from brushexp.contracts.machine import share
from brushexp_painters._laying import Array, numpy_generator, portions, strokes_from_arrays, vectors

SAMPLES = 400  # approximate number of pixels at which a candidate's error is measured
PIECES = 8  # line segments that approximate a curve
LARGEST_CANDIDATE = 0.25  # largest half-length of the first candidates, in shorter sides of the canvas
SMALLEST_CANDIDATE = 0.4  # smallest half-length of a candidate, in stroke spacings
CELLS = 48  # number of cells along the longer side of the error map
MAP_EVERY = 8  # number of strokes between two error maps
STEP_SIZE = 0.3  # size of the first mutations, in stroke lengths


@register("painter", "greedy")
@dataclass(kw_only=True)
class Greedy(Painter):
    """A greedy search: each stroke is the best of random candidates, refined by hill climbing, in its optimal colour.

    Source: Fogleman, 2016 (primitive), which follows Haeberli's trial and error (1990) and the evolutionary painters
    cited in the thesis. Each candidate gets the colour that minimises the squared error over the paint below, computed
    in closed form; the stroke that lowers the error most is kept and never changed again.

    Unlike in the source, shapes are strokes; candidates are sampled in proportion to the error, not uniformly; several
    mutations are tried at a time, and become smaller from round to round; and errors are measured at about 400 pixels
    per stroke. The search assumes plain strokes, even with other renderers.

    Args:
        candidates: number of random candidates per stroke.
        climbs: number of hill-climbing rounds per stroke.
        mutations: number of mutations of the best stroke tried per round.
        opacity: fraction of the paint below that a stroke hides, up to 1.
    """

    kind = "trial and error"
    author = "Fogleman"

    candidates: Annotated[int, at_least(1)] = 32
    climbs: Annotated[int, at_least(0)] = 8
    mutations: Annotated[int, at_least(1)] = 12
    opacity: Annotated[float, between(0.01, 1)] = 0.9

    def __call__(self, request: PaintRequest) -> Iterator[PaintState]:
        random, n = numpy_generator(request.generator), request.n
        target = np.ascontiguousarray(request.target.cpu().permute(1, 2, 0).numpy(), np.float32)
        canvas = np.broadcast_to(request.background.cpu().numpy(), target.shape).astype(np.float32)
        curves, thickness, colors = np.zeros((n, 3, 2)), np.zeros(n), np.zeros((n, 3))
        due = portions(n)
        for k in range(n):
            if k % MAP_EVERY == 0:
                places = worst_places(target, canvas, random)
            most = request.pitch + (1 - k / n) * LARGEST_CANDIDATE * min(request.size)
            stroke, color = self._best(target, canvas, places, (SMALLEST_CANDIDATE * request.pitch, most), random)
            lay_stroke(canvas, stroke, stroke[6], np.float32(self.opacity), color)
            curves[k], thickness[k], colors[k] = stroke[:6].reshape(3, 2), 2 * stroke[6], color
            if k + 1 in due:
                done = slice(k + 1)
                strokes = strokes_from_arrays(curves[done], thickness[done], colors[done], self.opacity)
                yield PaintState(strokes, k + 1, n)

    def _best(
        self, target: Array, canvas: Array, places: Array, lengths: tuple[float, float], random: np.random.Generator
    ) -> tuple[Array, Array]:
        """Find the stroke that lowers the error most; return its points and half-thickness (7,) and its colour (3,)."""

        def best_of(strokes: Array) -> tuple[Array, Array, float]:
            gain, color = np.zeros(len(strokes)), np.zeros((len(strokes), 3), np.float32)
            share(judge_strokes, len(strokes), target, canvas, strokes, np.float32(self.opacity), gain, color)
            best = int(gain.argmax())
            return strokes[best], color[best], gain[best]

        k = self.candidates
        middle = places[random.integers(len(places), size=k)] + random.uniform(-0.5, 0.5, (k, 2))
        reach = np.exp(random.uniform(np.log(lengths[0]), np.log(lengths[1]), k))
        along = vectors(reach, random.uniform(0, np.pi, k))
        bend = random.normal(0, 0.25, k)[:, None] * np.stack([-along[:, 1], along[:, 0]], 1)
        half = reach * random.uniform(0.2, 0.7, k)
        first = np.concatenate([middle - along, middle + bend, middle + along, half[:, None]], 1)
        stroke, color, gain = best_of(first.astype(np.float32))
        for climb in range(self.climbs):
            size = STEP_SIZE * (1 - climb / (self.climbs + 1)) * (float(np.linalg.norm(stroke[4:6] - stroke[:2])) + 2)
            change = random.standard_normal((self.mutations, 7)) * (random.random((self.mutations, 7)) < 0.5) * size
            change[:, 6] *= 0.3
            mutants = (stroke + change).astype(np.float32)
            mutants[:, 6] = mutants[:, 6].clip(0.5, None)
            best = best_of(mutants)
            if best[2] > gain:
                stroke, color, gain = best
        return stroke, color


def worst_places(target: Array, canvas: Array, random: np.random.Generator) -> Array:
    """Sample positions (256, 2) with probability proportional to the squared error of the canvas."""
    step = max(1, -(-max(target.shape) // CELLS))
    error = np.square(target - canvas).sum(2)
    rows, columns = (np.arange(0, side, step) for side in error.shape)
    cells = np.add.reduceat(np.add.reduceat(error, rows, 0), columns, 1).astype(np.float64)
    share = (cells + cells.mean() * 0.01 + 1e-9).ravel()
    row, column = np.divmod(random.choice(len(share), 256, p=share / share.sum()), len(columns))
    shift = random.uniform(0, step, (256, 2))
    return np.stack([columns[column] + shift[:, 0], rows[row] + shift[:, 1]], 1)


@inline
def _coverage(x, y, curve, half):
    """Compute a stroke's coverage at (x, y) from the distance to its curve; edges are one pixel wide."""
    nearest = np.float32(1e12)
    ax, ay = curve[0], curve[1]
    for piece in range(1, PIECES + 1):
        t = np.float32(piece / PIECES)
        u = np.float32(1) - t
        bx = u * u * curve[0] + np.float32(2) * t * u * curve[2] + t * t * curve[4]
        by = u * u * curve[1] + np.float32(2) * t * u * curve[3] + t * t * curve[5]
        dx, dy, px, py = bx - ax, by - ay, x - ax, y - ay
        share = min(max((px * dx + py * dy) / (dx * dx + dy * dy + np.float32(1e-9)), np.float32(0)), np.float32(1))
        ex, ey = px - share * dx, py - share * dy
        nearest = min(nearest, ex * ex + ey * ey)
        ax, ay = bx, by
    return min(max(half - np.sqrt(nearest) + np.float32(0.5), np.float32(0)), np.float32(1))


@inline
def _box(curve, half, height, width):
    """Find the half-open ranges of columns and rows that a stroke may touch."""
    left, right = min(curve[0], curve[2], curve[4]) - half, max(curve[0], curve[2], curve[4]) + half
    top, bottom = min(curve[1], curve[3], curve[5]) - half, max(curve[1], curve[3], curve[5]) + half
    x0, x1 = max(int(left) - 1, 0), min(int(right) + 2, width)
    y0, y1 = max(int(top) - 1, 0), min(int(bottom) + 2, height)
    return x0, x1, y0, y1


@function
def judge_strokes(begin, end, target, canvas, strokes, opacity, gain, color):
    """Compute the best colour of each of K strokes (K, 7), and how much it reduces the error of a canvas (H, W, 3).

    With coverage a, canvas v, colour c and r = target - (1 - a) v, the squared error is the sum of (a c - r)^2, which
    is smallest for c = sum ar / sum aa.
    """
    height, width = target.shape[0], target.shape[1]
    for k in range(begin, end):
        x0, x1, y0, y1 = _box(strokes[k], strokes[k, 6], height, width)
        step = max(1, int(np.sqrt(max(x1 - x0, 0) * max(y1 - y0, 0) / SAMPLES)))
        power, lower, red, green, blue = 1e-6, 0.0, 0.0, 0.0, 0.0
        for y in range(y0, y1, step):
            for x in range(x0, x1, step):
                a = opacity * _coverage(np.float32(x + 0.5), np.float32(y + 0.5), strokes[k], strokes[k, 6])
                if a > 0:
                    r0 = target[y, x, 0] - (np.float32(1) - a) * canvas[y, x, 0]
                    r1 = target[y, x, 1] - (np.float32(1) - a) * canvas[y, x, 1]
                    r2 = target[y, x, 2] - (np.float32(1) - a) * canvas[y, x, 2]
                    power += a * a
                    red += a * r0
                    green += a * r1
                    blue += a * r2
                    lower -= r0 * r0 + r1 * r1 + r2 * r2
                    for c in range(3):
                        lower += (target[y, x, c] - canvas[y, x, c]) ** 2
        color[k, 0] = min(max(red / power, 0.0), 1.0)
        color[k, 1] = min(max(green / power, 0.0), 1.0)
        color[k, 2] = min(max(blue / power, 0.0), 1.0)
        lower += color[k, 0] * (2 * red - color[k, 0] * power) + color[k, 1] * (2 * green - color[k, 1] * power)
        gain[k] = (lower + color[k, 2] * (2 * blue - color[k, 2] * power)) * step * step


@function
def lay_stroke(canvas, curve, half, opacity, color):
    """Paint a stroke onto a canvas (H, W, 3)."""
    x0, x1, y0, y1 = _box(curve, half, canvas.shape[0], canvas.shape[1])
    for y in range(y0, y1):
        for x in range(x0, x1):
            a = opacity * _coverage(np.float32(x + 0.5), np.float32(y + 0.5), curve, half)
            for c in range(3):
                canvas[y, x, c] += a * (color[c] - canvas[y, x, c])
