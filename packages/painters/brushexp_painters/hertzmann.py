"""The ``hertzmann`` painter: curved strokes in layers, from the largest to the smallest brush."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from brushexp.contracts import UserError, above, at_least, between, register
from brushexp.contracts.families import Painter, PaintRequest, PaintState
from brushexp.contracts.pictures import sample_at, worst_of_cells
from brushexp.contracts.strokes import Strokes
from brushexp_painters._laying import LUMINANCE, Array, lay, numpy_generator, strokes_from_arrays

FIRST_LAYER = 0.2  # approximate share of the strokes in the largest brush's layer
STEPS_PER_CURVE = 16  # approximate number of steps per Bezier curve
FLAT = 1e-9  # luminance gradient below which there is no direction


@register("painter", "hertzmann")
@dataclass(kw_only=True)
class Hertzmann(Painter):
    """Long curved strokes in layers: a large brush everywhere, then smaller brushes where the canvas still differs.

    Source: Hertzmann, 1998 (Painterly Rendering with Curved Brush Strokes of Multiple Sizes). Each brush of radius R
    paints the picture blurred by f_s R, in cells of f_g R. Where a cell's mean difference exceeds T, a stroke starts at
    the cell's worst pixel and follows the normals of the luminance gradient in steps of R, smoothed by f_c, until the
    canvas is closer to the picture than the stroke's colour is. The strokes of a layer are painted in random order.

    Unlike in the paper, each cubic B-spline is replaced by quadratic Bezier curves: one if it stays within
    ``tolerance``, otherwise several that meet; ``strokes`` counts these curves. The number of strokes replaces the
    threshold: each layer paints its worst cells (``threshold=100`` restores the paper's value, but the number of
    strokes still applies). In the first layer, bare canvas ends a stroke just as paint does; otherwise, all strokes
    would have the maximum length. The paper's styles are presets (`hertzmann_impressionist`) with the same ratios
    between brushes; with the paper's pixel sizes and thresholds (``scale=1 threshold=100``), a few thousand strokes
    leave most of a canvas bare.

    Args:
        radii: radii of the brushes, largest first, in units of ``scale``.
        scale: pixels per unit; null = chosen so that the first layer has about a fifth of the strokes.
        threshold: mean colour difference (T) above which a cell is painted, 0 to 441; null = as low as the number of
            strokes allows.
        blur: standard deviation of the blur (f_s), in radii.
        grid: side of a cell (f_g), in radii.
        curvature: smoothing of the direction (f_c); values below 1 straighten strokes.
        min_length: minimum number of steps per stroke.
        max_length: maximum number of steps per stroke.
        opacity: fraction of the paint below that a stroke hides, up to 1.
        jitter_rgb: random change in red, green and blue, as a fraction of their range.
        jitter_hsv: random change in hue, saturation and value.
        tolerance: maximum distance between a stroke and its Bezier curves, in radii.
    """

    kind = "local rules, and the canvas"
    author = "Hertzmann"

    radii: Annotated[tuple[float, ...], above(0, 1e4)] = (8.0, 4.0, 2.0, 1.0)
    scale: Annotated[float | None, above(0, 1e4, typical=1)] = None
    threshold: Annotated[float | None, at_least(0, typical=100)] = None
    blur: Annotated[float, between(0, 100)] = 0.5
    grid: Annotated[float, above(0, 100)] = 1.0
    curvature: Annotated[float, between(0, 1)] = 1.0
    min_length: Annotated[int, between(0, 1000)] = 1
    max_length: Annotated[int, between(0, 1000)] = 6
    opacity: Annotated[float, between(0, 1)] = 1.0
    jitter_rgb: Annotated[float, between(0, 2)] = 0.0
    jitter_hsv: Annotated[tuple[float, float, float], between(0, 2)] = (0.0, 0.0, 0.0)
    tolerance: Annotated[float, above(0, 100)] = 1.5

    def __post_init__(self) -> None:
        if not self.radii:
            raise UserError("radii=[] has no brush; give at least one: radii=[8,4,2]")

    def __call__(self, request: PaintRequest) -> Iterator[PaintState]:
        from scipy.ndimage import gaussian_filter  # noqa: PLC0415  (--help does not need it)

        target, n = request.target.cpu().numpy().astype(np.float64), request.n
        random, strokes = numpy_generator(request.generator), Strokes.none()
        radii = np.array(self.radii) * (self.scale or self._scale(request))
        for k, radius in enumerate(radii):
            reference = gaussian_filter(target, (0, self.blur * radius, self.blur * radius), mode="nearest")
            canvas = request.draw(strokes.map(lambda value: value.to(request.target))).cpu().numpy()
            cells = 1 / radii[k:] ** 2  # numbers of cells of this and later layers, up to a factor
            room = n - len(strokes)
            room = room if k == 0 else round(room * cells[0] / cells.sum())
            layer = self._layer(reference, canvas, radius, max(room, k == 0), random, everywhere=k == 0)
            for state in lay(layer):
                yield PaintState(Strokes.join(strokes, state.strokes), len(strokes) + state.step, n)
            strokes = Strokes.join(strokes, layer)

    def _scale(self, request: PaintRequest) -> float:
        """Choose the pixels per unit so that the largest brush's cells need a fraction `FIRST_LAYER` of the strokes."""
        cell = request.pitch * np.sqrt((1 + self.max_length / STEPS_PER_CURVE) / FIRST_LAYER)
        return float(cell / (self.grid * max(self.radii)))

    def _layer(
        self, reference: Array, canvas: Array, radius: float, room: int, random: np.random.Generator, everywhere: bool
    ) -> Strokes:
        """Make at most ``room`` strokes with one brush on a canvas (3, H, W)."""
        difference = 255 * np.linalg.norm(reference - canvas, axis=0)
        cells, x, y = worst_of_cells(difference, max(1, round(self.grid * radius)))
        error = np.nanmean(cells, 1)
        chosen = np.argsort(-error, kind="stable")
        if self.threshold is not None and not everywhere:
            chosen = chosen[error[chosen] > self.threshold]
        chosen = chosen[: max(room, 0)]
        if not len(chosen):
            return Strokes.none()
        x, y = x[chosen] + 0.5, y[chosen] + 0.5
        color = sample_at(reference, x, y)
        points, steps = self._trace(reference, canvas, x, y, color, radius)
        owner, curves = fit_curves(points, steps, self.tolerance * radius)
        place = random.permutation(len(x))
        order = np.argsort(place[owner[:room]], kind="stable")  # the curves of a stroke stay together
        color = self._jitter(color.T, random)[owner[order]]
        return strokes_from_arrays(curves[order], np.full(len(order), 2 * radius), color, self.opacity)

    def _trace(
        self, reference: Array, canvas: Array, x: Array, y: Array, color: Array, radius: float
    ) -> tuple[Array, Array]:
        """Trace S strokes of colours (3, S) from positions (S,); return points (S, L + 1, 2) and step counts (S,)."""
        from scipy.ndimage import sobel  # noqa: PLC0415

        luminance = np.tensordot(LUMINANCE, reference, 1)
        slope = np.stack([sobel(luminance, axis) for axis in (1, 0)])
        height, width = luminance.shape
        place, last = np.stack([x, y], 1), np.zeros((len(x), 2))
        points, steps = [place], np.zeros(len(x), int)
        goes_on = np.ones(len(x), bool)
        for step in range(1, self.max_length + 1):
            here = sample_at(reference, *place.T)
            nearer = np.linalg.norm(here - sample_at(canvas, *place.T), axis=0) < np.linalg.norm(here - color, axis=0)
            gx, gy = sample_at(slope, *place.T)
            steepness = np.hypot(gx, gy)
            goes_on &= ~((step > self.min_length) & nearer) & (steepness > FLAT)
            normal = np.stack([-gy, gx], 1) / np.maximum(steepness, FLAT)[:, None]
            normal *= np.where((normal * last).sum(1) < 0, -1, 1)[:, None]
            turned = self.curvature * normal + (1 - self.curvature) * last
            last = turned / np.maximum(np.linalg.norm(turned, axis=1), FLAT)[:, None]
            ahead = place + radius * last
            goes_on &= ((ahead >= 0) & (ahead < (width, height))).all(1)
            place = np.where(goes_on[:, None], ahead, place)
            steps += goes_on
            points.append(place)
        return np.stack(points, 1), steps

    def _jitter(self, color: Array, random: np.random.Generator) -> Array:
        if any(self.jitter_hsv):
            from skimage.color import hsv2rgb, rgb2hsv  # noqa: PLC0415

            hsv = rgb2hsv(color.clip(0, 1)) + self.jitter_hsv * random.uniform(-0.5, 0.5, color.shape)
            hsv[:, 0] %= 1
            color = hsv2rgb(hsv.clip(0, 1))
        return color + self.jitter_rgb * random.uniform(-0.5, 0.5, color.shape)


def fit_curves(points: Array, steps: Array, tolerance: float) -> tuple[Array, Array]:
    """Fit quadratic Bezier curves to polylines (S, L + 1, 2); return their line numbers (M,) and the curves (M, 3, 2).

    ``steps`` (S,) is the number of steps in each line. A line that deviates from its curve by more than ``tolerance``
    is split into two halves that meet. A line's curves are returned in their order along it.
    """
    line, first, last = np.arange(len(points)), np.zeros(len(points), int), steps
    pieces: list[tuple[Array, Array, Array]] = []
    while len(line):
        curves, away = least_squares_curves(points, line, first, last)
        good = (away <= tolerance) | (last - first < 2)
        pieces.append((line[good], first[good], curves[good]))
        middle = (first + last) // 2
        line, first, last = (
            np.concatenate([value[~good], other[~good]])
            for value, other in ((line, line), (first, middle), (middle, last))
        )
    lines, begins, all_curves = (np.concatenate(part) for part in zip(*pieces, strict=True))
    order = np.lexsort((begins, lines))
    return lines[order], all_curves[order]


def least_squares_curves(points: Array, line: Array, first: Array, last: Array) -> tuple[Array, Array]:
    """Fit curves (M, 3, 2) to M lines from point ``first`` to point ``last``, and measure their maximum errors (M,)."""
    number = np.arange(points.shape[1])
    inside = (first[:, None] < number) & (number < last[:, None])
    t = ((number - first[:, None]) / np.maximum(last - first, 1)[:, None]) * inside  # points are evenly spaced
    polyline, start, end = points[line], points[line, first], points[line, last]
    weight = 2 * t * (1 - t) * inside
    ends = (1 - t)[..., None] ** 2 * start[:, None] + t[..., None] ** 2 * end[:, None]
    power = (weight**2).sum(1)
    control = (weight[..., None] * (polyline - ends)).sum(1) / np.maximum(power, 1e-12)[:, None]
    control = np.where(power[:, None] > 0, control, (start + end) / 2)
    away = np.linalg.norm(ends + weight[..., None] * control[:, None] - polyline, axis=2) * inside
    return np.stack([start, control, end], 1), away.max(1)
