"""Place marks end to end in parallel rows that follow forms and meander where there are none."""

import heapq
import math
from dataclasses import dataclass, replace
from itertools import count
from typing import Annotated

import numpy as np
import torch
from torch import Tensor

from brushexp.contracts import above, between, register
from brushexp.contracts.families import Initializer
from brushexp.contracts.members import FAR_AWAY, InLayers
from brushexp.contracts.pictures import FarStructure, along_edges, sample_at
from brushexp.contracts.strokes import Strokes
from brushexp_media.init.accents import accents
from brushexp_media.init.ink import INK, rgb_of, strokes_of
from brushexp_media.picture.noise import fractal_noise

Array = np.ndarray
BLUR = 0.35  # standard deviation of the blur of a layer's picture, in row distances
STEP = 0.5  # row distances between points of a mark
CLOSEST_MARKS = 0.5  # least distance between marks, in row distances
ELSEWHERE = 0.5  # weight of detail where no row continues
DARKER = 0.75  # brightness of the underpainting relative to the picture
SHORTEST_MARK = 0.2  # least length of a mark relative to the full length
UNEVEN = (0.2, 2.0)  # least and largest length of an uninterrupted mark relative to the mean
WIDER = 0.38  # standard deviation of the logarithm of widths between marks
ASTRAY = 0.25  # share of ``looseness`` that remains where forms are strong
APART = (0.85, 1.25)  # least and largest distance to the next row relative to the mean
FULL = 1.7  # number of full-length marks, relative to one covering of the canvas, because many end early
CALM = 0.006  # differences of neighbouring pixels below which noise replaces the forms
TURNS = 0.4  # longer sides between turns of the noise
INKED = 0.5  # shift of outlines from the picture's colour towards their own
OUTLINE = 2.0, 1.3  # length and width of the strongest outline relative to the finest marks
THIRDS = 2 * math.pi / 3 * np.arange(3)
MIDDLE = np.array([0.25, 0.5, 0.25])  # weights of a curve's control points at its middle


@register("init", "rows")
@dataclass(kw_only=True)
class InRows(Initializer):
    """Long marks in parallel rows along forms, with larger marks everywhere and smaller marks where there is detail.

    Rows are evenly spaced streamlines (Jobard and Lefer, 1997) along the direction in which the picture changes least.
    Unlike in the source, lines are cut into marks, which end where the picture no longer has their colour. Where the
    picture hardly changes, rows follow the contour lines of noise.

    Args:
        layers: number of layers, from large to small marks.
        ratio: mark size in a layer, relative to the layer below.
        cover: canvas area that a layer covers, as a fraction of the area that the layer below covers.
        under: fraction of the marks that form an underpainting, 0 to 1.
        outlines: fraction of the marks that are outlines, 0 to 1.
        width: mark width, relative to the spacing of rows.
        length: mark length, relative to the spacing of rows.
        edges: colour difference from the picture at which a mark ends, 0 to 1.
        turning: amount by which rows turn where the picture has no forms; 0 = horizontal rows.
        calm: weight of these turns relative to the picture's forms; higher values keep faint forms from bending rows.
        bend: bend of a mark relative to its row: 1 follows the row, 0 is straight, like a knife stroke.
        looseness: standard deviation, in radians, of the turn and bend of marks relative to their row where there are
            no forms.
        variety: variation in hue and lightness between marks, 0 to 1.
        values: standard deviation of an additional variation in lightness alone between marks, 0 to 1.
        outline: colour of outlines, as '#rrggbb'.
    """

    layers: Annotated[int, between(1, 8)] = 3
    ratio: Annotated[float, between(0.2, 1)] = 0.55
    cover: Annotated[float, above(0, 1)] = 0.6
    under: Annotated[float, between(0, 1)] = 0.1
    outlines: Annotated[float, between(0, 1)] = 0.06
    width: Annotated[float, above(0, 10)] = 1.2
    length: Annotated[float, above(0, 100)] = 8.0
    edges: Annotated[float, between(0, 1)] = 0.12
    turning: Annotated[float, between(0, 10)] = 1.0
    calm: Annotated[float, above(0, 100)] = 1.0
    bend: Annotated[float, between(0, 1)] = 1.0
    looseness: Annotated[float, between(0, 2)] = 0.25
    variety: Annotated[float, between(0, 1)] = 0.1
    values: Annotated[float, between(0, 1)] = 0.0
    outline: Annotated[str, INK] = "#1b2340"

    def __call__(self, target: Tensor, n: int, generator: torch.Generator, focus: Tensor | None = None) -> Strokes:
        random = np.random.default_rng(int(torch.randint(2**31, (1,), generator=generator)))
        under = max(1, round(n * self.under))
        lines = min(n - under, round(n * self.outlines))
        ground = InLayers(layers=1, underpainting=True, opacity=1.0)(target, under, generator, focus)
        ground = replace(ground, color=DARKER * ground.color)
        picture = target.numpy().astype(np.float64)
        weight = np.ones(picture.shape[1:]) if focus is None else focus.numpy().astype(np.float64)
        marks, finest = self._marks(picture, weight, n - under - lines, random)
        length, width = OUTLINE[0] * self.length * finest, OUTLINE[1] * self.width * finest
        ink = rgb_of(self.outline)
        drawn = accents(picture, lines, length, width, weight, dark=True, toward=ink, share=INKED)
        return Strokes.join(ground, marks, drawn)

    def _marks(self, picture: Array, weight: Array, n: int, random: np.random.Generator) -> tuple[Strokes, float]:
        """Place n marks in layers; return them and the distance between the finest rows."""
        shares = (self.cover / self.ratio**2) ** np.arange(self.layers)
        asked = n * shares.cumsum() / shares.sum()  # cumulative number up to each layer
        asked[0] = n if self.layers > 1 else asked[0]  # the first layer covers the canvas, however many it takes
        distance = math.sqrt(FULL * weight.size / max(n * shares[0] / shares.sum(), 1) / self.length)
        calm = self.calm**2 * _turns(picture.shape[1:], self.turning, random)
        calm /= weight.clip(1)  # faces are modelled by their forms
        curves: list[Array] = []
        colors, widths, below = [], [], picture
        for number, up_to in enumerate(asked):
            blurred = _blur(picture, BLUR * distance)
            detail = weight * np.abs(blurred - below).sum(0) if number else np.ones_like(weight)
            tensor = FarStructure(blurred)([(reach * distance, share) for reach, share in FAR_AWAY])
            loose = self.looseness * (ASTRAY + (1 - ASTRAY) * CALM**2 / (CALM**2 + tensor[0] + tensor[2]))
            rows = Rows(blurred, along_edges(tensor + calm), loose, distance, self.length, self.edges, random)
            curve, size = rows.grow(detail, round(up_to) - sum(len(curve) for curve in curves))
            straight = 0.5 * (curve[:, :1] + curve[:, 2:])  # the middle of a straight curve
            curve[:, 1:2] = straight + self.bend * (curve[:, 1:2] - straight)
            curves.append(curve)
            colors.append(sample_at(blurred, *np.tensordot(curve, MIDDLE, (1, 0)).T).T)
            widths.append(self.width * distance * size)
            below, distance = blurred, self.ratio * distance
        curve = np.concatenate(curves)
        calmer = sample_at(weight, *curve.mean(1).T).clip(1) ** -0.5  # faces keep their colour
        color = _vary_colors(np.concatenate(colors), self.variety * calmer[:, None], random)
        if self.values:
            color = (color + self.values * calmer[:, None] * random.standard_normal((len(color), 1))).clip(0, 1)
        marks = strokes_of(curve, np.concatenate(widths), np.ones(len(curve), bool), color, n)
        return marks, distance / self.ratio


class Rows:
    """Rows of marks in a picture (3, H, W), ``distance`` pixels apart, along a flow (H, W) in radians.

    Marks deviate from the flow by ``loose`` (H, W), a standard deviation in radians. ``length`` is the length of a mark
    relative to ``distance``; a mark ends where the picture differs from the mark's colour by more than ``edges``.
    """

    def __init__(
        self, picture: Array, flow: Array, loose: Array, distance: float, length: float, edges: float,
        random: np.random.Generator,
    ) -> None:  # fmt: skip
        self.picture, self.loose, self.distance = picture, loose, distance
        self.length, self.edges, self.random = length, edges, random
        self.ahead = np.stack([np.cos(flow), np.sin(flow)], -1)
        self.taken: Array = np.zeros(flow.shape, bool)

    def grow(self, detail: Array, n: int) -> tuple[Array, Array]:
        """Grow at most ``n`` adjacent marks (m, 3, 2) of sizes (m,), beginning where ``detail`` (H, W) is largest."""
        y, x = (np.arange(self.distance / 2, side, self.distance) for side in detail.shape)
        places, numbers = np.stack(np.meshgrid(x, y), -1).reshape(-1, 2), count()
        marks: list[Array] = []
        sizes = self.random.lognormal(0, WIDER, n)
        seeds = [(-ELSEWHERE * detail[_pixel(place)], next(numbers), place) for place in places]
        heapq.heapify(seeds)
        while seeds and len(marks) < n:
            mark = self._mark(heapq.heappop(seeds)[2])
            if len(mark) <= SHORTEST_MARK * self.length / STEP:
                continue
            size = sizes[len(marks)]
            marks.append(mark[[0, len(mark) // 2, -1]])
            self._take(mark, CLOSEST_MARKS * size * self.distance)
            for place in filter(self._is_inside, self._around(mark, size)):
                heapq.heappush(seeds, (-detail[_pixel(place)], next(numbers), place))
        start, middle, end = np.array(marks).reshape(-1, 3, 2).swapaxes(0, 1)
        return np.stack([start, 2 * middle - (start + end) / 2, end], 1), sizes[: len(marks)]

    def _is_inside(self, point: Array) -> bool:
        height, width = self.taken.shape
        return bool(0 <= point[0] < width and 0 <= point[1] < height)

    def _color(self, point: Array) -> Array:
        row, column = _pixel(point)
        return self.picture[:, row, column]

    def _mark(self, seed: Array) -> Array:
        """Trace a mark (k, 2) from a seed in both directions; the mark is empty if another mark covers the seed."""
        if self.taken[_pixel(seed)]:
            return np.empty((0, 2))
        steps = round(self.random.uniform(*UNEVEN) * self.length / STEP / 2)
        turn, bend = self.loose[_pixel(seed)] * self.random.standard_normal(2)
        before, after = (self._trace(seed, way, turn + way * bend * np.linspace(0, 1, steps)) for way in (-1, 1))
        return np.array([*before[::-1], seed, *after])

    def _trace(self, seed: Array, way: int, turns: Array) -> list[Array]:
        """Follow the flow, rotated by an angle per step, until the picture's colour changes or another mark is near."""
        point, going, points = seed, way * self.ahead[_pixel(seed)], []
        color = self._color(seed)
        for c, s in zip(np.cos(turns), np.sin(turns), strict=True):
            point = point + STEP * self.distance * np.array([c * going[0] - s * going[1], s * going[0] + c * going[1]])
            if not self._is_inside(point) or self.taken[_pixel(point)]:
                break
            if np.abs(self._color(point) - color).max() > self.edges:
                break
            points.append(point)
            turned = self.ahead[_pixel(point)]
            going = turned if turned @ going > 0 else -turned
        return points

    def _take(self, mark: Array, reach: float) -> None:
        """Reserve all pixels closer than ``reach`` to the points of a mark (k, 2)."""
        (left, top), (right, bottom) = (mark.min(0) - reach).clip(0).astype(int), (mark.max(0) + reach + 1).astype(int)
        box = self.taken[top:bottom, left:right]
        y, x = (np.arange(side) + 0.5 for side in box.shape)
        square = (x[:, None] + left - mark[:, 0]) ** 2 + (y[:, None, None] + top - mark[:, 1]) ** 2
        box |= square.min(-1) < reach**2

    def _around(self, mark: Array, size: float) -> list[Array]:
        """Return seeds for the next marks in the same row and in the two neighbouring rows."""
        first, middle, last = mark[0], mark[len(mark) // 2], mark[-1]
        along = self.distance * (last - first) / max(math.hypot(*(last - first)), 1e-9)
        across = size * self.random.uniform(*APART) * np.array([-along[1], along[0]])
        return [last + along, first - along, middle + across, middle - across]


def _pixel(point: Array) -> tuple[int, int]:
    return int(point[1]), int(point[0])


def _turns(size: tuple[int, int], turning: float, random: np.random.Generator) -> Array:
    """Compute structure tensors (3, H, W) of a noisy vertical ramp, which guide rows where there are no forms."""
    y, x = (torch.arange(side + 1) / (TURNS * max(size)) for side in size)
    seed = int(random.integers(2**31))
    noise = fractal_noise(x.expand(len(y), -1), y[:, None].expand(-1, len(x)), seed, 2).double().numpy()
    height = turning * noise + y[:, None].double().numpy()
    slope = np.stack([height[:-1, 1:] - height[:-1, :-1], height[1:, :-1] - height[:-1, :-1]])
    slope *= CALM / np.hypot(*slope).clip(1e-9)
    return np.stack([slope[0] ** 2, slope[0] * slope[1], slope[1] ** 2])


def _vary_colors(color: Array, variety: Array, random: np.random.Generator) -> Array:
    """Shift colours (m, 3) by ``variety`` (m, 1) in random directions of hue and lightness."""
    hue = np.cos(random.uniform(0, 2 * math.pi, len(color))[:, None] + THIRDS)
    return (color + variety * (hue + random.normal(0, 0.7, (len(color), 1)))).clip(0, 1)


def _blur(picture: Array, sigma: float) -> Array:
    from scipy.ndimage import gaussian_filter  # noqa: PLC0415  (slow to import)

    blurred: Array = gaussian_filter(picture, (0, sigma, sigma))
    return blurred
