"""Plots as SVG that follow the colours of a page: geometry is computed here and drawn by ``plots.html.j2``."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

WIDTH, HEIGHT = 420, 260  # units; a plot is about as wide in pixels
LEFT, RIGHT, TOP, BOTTOM = 54, 14, 14, 46
WIDE = 20.0  # largest over smallest number from which an axis may be logarithmic
MOST_POINTS = 400  # of a line
TICKS = 5
BINS = 28
TAIL = 0.99  # share of the numbers that a histogram shows one by one; the rest is in its last bar
SECTORS = 18  # of half a turn
LARGE, SMALL = 1e5, 1e-3  # from where numbers at an axis are written with an exponent


@dataclass(frozen=True)
class Tick:
    """A mark on an axis: where, and what is written there."""

    at: float
    label: str


@dataclass(frozen=True)
class Bar:
    """A rectangle of a histogram, and what it says when it is pointed at."""

    x: float
    y: float
    width: float
    height: float
    title: str


@dataclass(frozen=True)
class Plot:
    """What ``plots.html.j2`` draws.

    Attributes:
        title: above it.
        summary: what it shows, in a sentence, for those who cannot see it.
        x_label: below it.
        y_label: above its vertical axis.
        x_ticks: along x.
        y_ticks: along y.
        lines: paths of SVG.
        bars: rectangles.
        mark: a vertical line with a label.
    """

    title: str
    summary: str
    x_label: str
    y_label: str
    x_ticks: list[Tick]
    y_ticks: list[Tick]
    lines: list[str] = field(default_factory=list)
    bars: list[Bar] = field(default_factory=list)
    mark: Tick | None = None
    width: int = WIDTH
    height: int = HEIGHT
    left: int = LEFT
    right: int = WIDTH - RIGHT
    top: int = TOP
    bottom: int = HEIGHT - BOTTOM


@dataclass(frozen=True)
class Scale:
    """From numbers to places along an axis.

    Attributes:
        low: number at ``first``.
        high: number at ``last``, > low.
        first: place in units.
        last: place in units.
        log: whether the axis is logarithmic; then low > 0.
    """

    low: float
    high: float
    first: float
    last: float
    log: bool = False

    def __call__(self, value: float) -> float:
        """The place of a number; one beyond the axis lies at its end."""
        if self.log:
            share = math.log(max(value, 1e-300) / self.low) / math.log(self.high / self.low)
        else:
            share = (value - self.low) / (self.high - self.low)
        return self.first + min(max(share, 0.0), 1.0) * (self.last - self.first)

    def ticks(self, most: int = TICKS) -> list[Tick]:
        """Marks at round numbers."""
        values = round_numbers_log(self.low, self.high) if self.log else round_numbers(self.low, self.high, most)
        return [Tick(round(self(value), 1), short(value)) for value in values]


def round_numbers(low: float, high: float, most: int = TICKS) -> list[float]:
    """At most so many multiples of 1, 2 or 5 times a power of ten, and the ends if those are such."""
    step = 10.0 ** math.floor(math.log10((high - low) / most))
    step *= next(factor for factor in (1, 2, 5, 10, 20) if (high - low) / (factor * step) <= most)
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    return [k * step for k in range(first, last + 1)]


def round_numbers_log(low: float, high: float) -> list[float]:
    """Powers of ten, with 2 and 5 times those if they are few."""
    powers = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    for factors in ((1,), (1, 3), (1, 2, 5)):
        found = [f * 10.0**k for k in powers for f in factors if low * (1 - 1e-9) <= f * 10.0**k <= high * (1 + 1e-9)]
        if len(found) >= 3:
            break
    return found[:: 1 + len(found) // 8]


def short(value: float) -> str:
    """A number at an axis."""
    if value and not SMALL <= abs(value) < LARGE:
        digits, _, power = f"{value:.1e}".partition("e")
        return f"{digits.removesuffix('.0')}e{int(power)}"
    return f"{round(value, 6):,g}" if abs(value) < 1000 else f"{value:,.0f}"


def line_plot(title: str, x: Sequence[float], y: Sequence[float], x_label: str, unit: str = "") -> Plot | None:
    """A curve; None if it has no two points that can be drawn, or not as many of x as of y.

    Args:
        title: what goes up and down.
        x: rising.
        y: as many; an axis of positive numbers that differ by much is logarithmic, unless they have a unit.
        x_label: of the axis.
        unit: of y.
    """
    if len(x) != len(y):
        return None
    points = np.array([x, y], float)
    points = points[:, np.isfinite(points).all(0)]
    if points.shape[1] < 2 or points[0, 0] == points[0, -1]:
        return None
    if points.shape[1] > MOST_POINTS:
        points = points[:, np.linspace(0, points.shape[1] - 1, MOST_POINTS).round().astype(int)]
    low, high = float(points[1].min()), float(points[1].max())
    log = not unit and low > 0 and high / low > WIDE
    horizontal = Scale(min(0.0, float(points[0, 0])), float(points[0, -1]), LEFT, WIDTH - RIGHT)
    vertical = _vertical(low, high, log)
    places = [f"{horizontal(a):.1f} {vertical(b):.1f}" for a, b in points.T.tolist()]
    after, ends = short(points[0, -1]), [f"{value:.4g}" for value in (points[1, 0], points[1, -1])]
    return Plot(
        title=f"{title}, {unit}" if unit else title,
        summary=f"{title}: from {ends[0]} to {ends[1]} {unit} at {after} {x_label}",
        x_label=x_label,
        y_label="logarithmic" if log else "",
        x_ticks=horizontal.ticks(),
        y_ticks=vertical.ticks(),
        lines=["M" + "L".join(places)],
    )


def _vertical(low: float, high: float, log: bool = False) -> Scale:
    """A vertical axis with some air above and below."""
    bottom, top = HEIGHT - BOTTOM, TOP
    if log:
        air = (high / low) ** 0.06
        return Scale(low / air, high * air, bottom, top, log=True)
    air = 0.06 * (high - low) or 0.05 * abs(high) or 1.0
    return Scale(low - air if low < 0 or low > air else 0.0, high + air, bottom, top)


def histogram(title: str, values: np.ndarray, x_label: str) -> Plot | None:
    """How many strokes have which value, >= 0; the median is marked. None if there are none."""
    values = values[np.isfinite(values)]
    if not len(values):
        return None
    largest, middle = float(values.max()), float(np.median(values))
    end = float(np.quantile(values, TAIL)) or largest or 1.0
    if largest < 1.15 * end:
        end = largest or 1.0
    counts, edges = np.histogram(np.minimum(values, end), BINS, (0.0, end))
    horizontal = Scale(0.0, end, LEFT, WIDTH - RIGHT)
    vertical = Scale(0.0, 1.08 * float(counts.max()), HEIGHT - BOTTOM, TOP)
    bars = []
    for k, count in enumerate(counts.tolist()):
        left, right, top = horizontal(edges[k]), horizontal(edges[k + 1]), vertical(count)
        beyond = k == BINS - 1 and largest > end
        upper = short(round(largest if beyond else edges[k + 1], 2))
        title_ = f"{short(round(edges[k], 2))} to {upper}: {count:,} strokes"
        bars.append(Bar(left + 0.7, top, right - left - 1.4, HEIGHT - BOTTOM - top, title_))
    more = f"; the last bar goes on to {short(round(largest, 1))}" if largest > end else ""
    return Plot(
        title=title,
        summary=f"{title}: half of the strokes are below {middle:.3g}; {x_label}",
        x_label=x_label + more,
        y_label="strokes",
        x_ticks=horizontal.ticks(),
        y_ticks=[tick for tick in vertical.ticks(4) if float(tick.label.replace(",", "")).is_integer()],
        bars=bars,
        mark=Tick(round(horizontal(middle), 1), f"median {middle:.3g}"),
    )


@dataclass(frozen=True)
class Rose:
    """Directions as sectors of a circle around (0, 0); a direction shows on both sides.

    Attributes:
        summary: in a sentence.
        sectors: path of SVG, and what it says when it is pointed at.
        radius: of the rim.
    """

    summary: str
    sectors: list[tuple[str, str]]
    radius: float


def rose(angles: np.ndarray, weights: np.ndarray, radius: float = 100.0) -> Rose | None:
    """Share of the weight by direction; sectors have areas in proportion to it. None without directions.

    Args:
        angles: (N,) radians in [0, pi), clockwise from the x axis as seen; NaN for none.
        weights: (N,) >= 0.
        radius: of the largest sector, units.
    """
    kept = np.isfinite(angles) & (weights > 0)
    if not kept.any():
        return None
    step = math.pi / SECTORS
    number = ((angles[kept] + step / 2) / step).astype(int) % SECTORS  # the first sector is centred on 0
    shares = np.bincount(number, weights[kept], SECTORS)
    shares = shares / shares.sum()
    sectors = []
    for k, share in enumerate(shares.tolist()):
        reach = radius * math.sqrt(share / shares.max())
        for turn in (0.0, math.pi):
            ends = [k * step + turn + side * step / 2 for side in (-0.94, 0.94)]
            (a, b), (c, d) = ((reach * math.cos(end), reach * math.sin(end)) for end in ends)
            path = f"M0 0L{a:.1f} {b:.1f}A{reach:.1f} {reach:.1f} 0 0 1 {c:.1f} {d:.1f}Z"
            sectors.append((path, f"{math.degrees(k * step):.0f}°: {share:.1%}"))
    most = math.degrees(int(shares.argmax()) * step)
    return Rose(f"Directions: most of the length lies near {most:.0f} degrees", sectors, radius)
