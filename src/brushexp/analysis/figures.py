"""One sheet that shows the brushwork of a painting, or of two with the same axes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from brushexp.analysis.columns import MEASURES, Array
from brushexp.analysis.maps import coherence_map, direction_colors, stroke_map
from brushexp.analysis.samples import DIRECTION_BINS, direction_shares
from brushexp.analysis.summary import OVERALL, Analysis, overall_of
from brushexp.analysis.summary_text import relative_unit, strokes_in, three_digits, with_unit
from brushexp.results.plotting import COLORS, FAINT, INK, SIZE, new_figure, save_figure, tidy, without_math
from brushexp.strokes.measures import NEIGHBOURS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PRINT_DPI = 200  # dots per inch: sharp on paper
LEFT, PICTURE, GAP = 0.75, (4.25, 5.0), 0.35  # inches: margin, room for a picture, and between two
HEAD, TITLE = 0.55, 0.3  # inches: of the heading of a painting, and of the title of a picture
ROSE, LINE = 2.7, 0.19  # inches: of the rose, and of a line of numbers below it
PANEL, ROW = (2.7, 1.7), 2.75  # inches: of a histogram, and from one row of them to the next
MAP_CELLS = 160  # places along the longer side where coherence is looked at
DASHES = 26  # lines of flow along the longer side
SCALE_SHARE = 0.6  # share of the colours of a scale: on darker ones lines are not seen
PANELS = ("length", "width", "straightness", "curvature", "elongatedness", "visible", "coherence", "homogeneity")
FULL_RANGE = ("curvature", "visible", "coherence")  # shown from 0 to their highest value
TAIL_SHARE = 0.02  # share of strokes that a panel may leave out at its long end
HISTOGRAM_BINS = 32
ROSE_NUMBERS = (
    "direction",
    "agreement",
    "coherence",
    "disorder",
    "entropy",
    "layers",
    "hidden",
)  # numbers below the rose
MUTED = "#6a6a6a"


@dataclass(frozen=True)
class Page:
    """A figure on which places are inches from the left and from the top."""

    figure: Figure
    height: float

    def axes(self, left: float, top: float, width: float, height: float, **kind: Any) -> Axes:
        """Axes at a place."""
        box = (left / SIZE[0], 1 - (top + height) / self.height, width / SIZE[0], height / self.height)
        return self.figure.add_axes(box, **kind)

    def write(self, left: float, top: float, text: str, **look: Any) -> None:
        """A line of text, whose upper left corner is given."""
        self.figure.text(left / SIZE[0], 1 - top / self.height, text, va="top", **look)


def write_figure(path: Path, found: Sequence[Analysis]) -> Path:
    """Write the sheet as PNG: for each painting its strokes by direction, coherence and rose; histograms below."""
    sizes = [_fitted(one.size) for one in found]
    rows = [max(height, ROSE + 0.3 + LINE * len(ROSE_NUMBERS)) + HEAD + TITLE + 0.25 for _, height in sizes]
    height = sum(rows) + 2 * ROW + 0.35
    figure = new_figure(height)
    figure.set_layout_engine("none")
    figure.set_dpi(PRINT_DPI)
    page = Page(figure, height)
    largest = max(direction_shares(_angles(one)).max() for one in found)
    top = 0.2
    for k, (one, size) in enumerate(zip(found, sizes, strict=True)):
        _painting(page, top, one, size, COLORS[k] if len(found) > 1 else INK, largest)
        top += rows[k]
    for k, key in enumerate(PANELS):
        left = LEFT + (k % 4) * (SIZE[0] - LEFT - 0.25 - PANEL[0]) / 3
        axes = page.axes(left, top + 0.45 + (k // 4) * ROW, *PANEL)
        _histogram(axes, key, found)
        if k % 4 == 0:
            axes.set_ylabel("share of strokes", fontsize=9, color=MUTED)
            axes.yaxis.set_label_coords(-0.2, 0.5)
    save_figure(figure, path)
    return path


def _fitted(size: tuple[int, int]) -> tuple[float, float]:
    """Width and height of the pictures of a canvas, inches."""
    zoom = min(PICTURE[0] / size[1], PICTURE[1] / size[0])
    return max(size[1] * zoom, 0.05), max(size[0] * zoom, 0.05)


def _angles(found: Analysis) -> Array:
    angle = found.measures.orientation
    return angle[np.isfinite(angle)]


# the pictures


def _painting(page: Page, top: float, found: Analysis, size: tuple[float, float], ink: str, largest: float) -> None:
    """Heading and pictures of one painting."""
    page.write(LEFT, top, without_math(found.name)[:60], fontsize=14, color=ink, weight="bold")
    page.write(
        LEFT, top + 0.27, f"{strokes_in(found)} on {found.size[1]} x {found.size[0]} px; "
        f"one pitch, the distance between neighbouring strokes, is {three_digits(found.pitch)} px",
        fontsize=9, color=MUTED,
    )  # fmt: skip
    top += HEAD
    second = LEFT + PICTURE[0] + GAP
    third = second + PICTURE[0] + 1.05
    page.write(LEFT, top, "strokes in the colours of their directions", fontsize=10)
    _strokes(page.axes(LEFT, top + TITLE, *size), found, ink)
    page.write(second, top, f"coherence of the directions of the {NEIGHBOURS} nearest strokes", fontsize=10)
    axes = page.axes(second, top + TITLE, *size)
    _coherence(axes, page.axes(second + size[0] + 0.1, top + TITLE, 0.12, min(size[1], 2.4)), found, ink)
    page.write(third, top, "directions as they lie; dotted: all equal", fontsize=10)
    _rose(page.axes(third + 0.1, top + TITLE + 0.2, ROSE, ROSE, projection="polar"), found, largest)
    numbers, top = overall_of(found), top + TITLE + ROSE + 0.45
    for k, key in enumerate(ROSE_NUMBERS):
        page.write(third, top + k * LINE, OVERALL[key].name, fontsize=8.5, color=MUTED)
        page.write(third + 2.2, top + k * LINE, with_unit(numbers[key], OVERALL[key].unit), fontsize=8.5, color=INK)


def _strokes(axes: Axes, found: Analysis, ink: str) -> None:
    height, width = found.size
    axes.imshow(stroke_map(found), extent=(0, width, height, 0), interpolation="antialiased", aspect="auto")
    _framed(axes, ink)


def _framed(axes: Axes, ink: str) -> None:
    """A picture with a thin frame and no numbers."""
    axes.set(xticks=[], yticks=[])
    axes.spines[:].set(color=ink, linewidth=0.8 if ink == INK else 1.8)


def _coherence(axes: Axes, scale: Axes, found: Analysis, ink: str) -> None:
    """How parallel strokes are, with lines that follow them, longer where they agree."""
    from matplotlib import colormaps  # noqa: PLC0415
    from matplotlib.collections import LineCollection  # noqa: PLC0415
    from matplotlib.colors import ListedColormap  # noqa: PLC0415

    height, width = found.size
    _, mean = coherence_map(found, MAP_CELLS)
    colors = ListedColormap(colormaps["YlGnBu"](np.linspace(0, SCALE_SHARE, 256)))
    coherence = np.linalg.norm(mean, axis=-1)
    image = axes.imshow(
        coherence, extent=(0, width, height, 0), cmap=colors, vmin=0, vmax=1, interpolation="bilinear", aspect="auto"
    )
    axes.set_facecolor(FAINT)  # where there are too few strokes
    points, mean = coherence_map(found, DASHES)
    known = np.isfinite(mean[..., 0])
    cos, sin = mean[known].T
    length, way = 0.47 * max(found.size) / DASHES * np.hypot(cos, sin), 0.5 * np.arctan2(sin, cos)
    ends = length[:, None] * np.stack([np.cos(way), np.sin(way)], axis=1)
    lines = np.stack([points[known] - ends, points[known] + ends], axis=1)
    axes.add_collection(LineCollection(list(lines), colors=INK, linewidths=1.0, capstyle="round"), autolim=False)
    _framed(axes, ink)
    axes.figure.colorbar(image, cax=scale)
    scale.spines[:].set_visible(False)
    scale.set_yticks([0, 0.5, 1], ["0 disorder", "0.5", "1 parallel"], fontsize=8)
    scale.tick_params(length=0)


def _rose(axes: Any, found: Analysis, largest: float) -> None:
    """Shares of directions as areas, each drawn both ways."""
    from matplotlib.patheffects import withStroke  # noqa: PLC0415

    share = direction_shares(_angles(found))
    middle = np.arange(DIRECTION_BINS) * math.pi / DIRECTION_BINS
    both, colors = np.concatenate([middle, middle + math.pi]), np.tile(direction_colors(middle), (2, 1))
    axes.set_theta_direction(-1)
    axes.bar(both, np.sqrt(np.tile(share, 2)), math.pi / DIRECTION_BINS, color=colors, edgecolor="white", linewidth=0.6)
    axes.plot(
        np.linspace(0, 2 * math.pi, 200), np.full(200, math.sqrt(1 / DIRECTION_BINS)), ":", color=INK, linewidth=1.0
    )
    top = max(largest, 1.3 / DIRECTION_BINS)
    ring = next(step for step in (0.02, 0.05, 0.1, 0.2, 0.5, 1.0) if 3 * step >= top)
    rings = [ring * k for k in range(1, 4) if ring * k <= top]
    axes.set_ylim(0, math.sqrt(top) * 1.03)
    axes.set_yticks(np.sqrt(rings), [])
    for each in rings:
        edge = [withStroke(linewidth=2.5, foreground="white")]
        axes.text(math.radians(65), math.sqrt(each), f"{100 * each:g} %", fontsize=7.5, path_effects=edge, zorder=5)
    axes.set_xticks(np.arange(8) * math.pi / 4, [f"{45 * k % 180}°" for k in range(8)], fontsize=9)
    axes.tick_params(pad=-1)
    axes.grid(color=FAINT, linewidth=0.6)
    axes.set_axisbelow(True)
    axes.spines["polar"].set_visible(False)


# the histograms


def _histogram(axes: Axes, key: str, found: Sequence[Analysis]) -> None:
    """Shares of strokes by one measure, and the median; in pitches if paintings are compared."""
    tidy(axes)
    axes.grid(axis="x", visible=False)
    compared = len(found) > 1
    samples = [one.relative(key) if compared else one.values(key) for one in found]
    unit = relative_unit(key) if compared else MEASURES[key].unit
    axes.set_xlabel(MEASURES[key].name + (f", {unit}" if unit else ""), fontsize=10)
    axes.yaxis.set_major_formatter(lambda value, _: f"{value:g} %")
    filled = [values for values in samples if len(values)]
    if not filled:
        axes.set(xticks=[], yticks=[])
        axes.text(0.5, 0.5, "not defined", transform=axes.transAxes, ha="center", color=MUTED)
        return
    edges = np.linspace(*_range(key, filled), HISTOGRAM_BINS + 1)
    for values, color, dash in zip(samples, COLORS, ("-", "--"), strict=False):
        if len(values):
            count = 100 * np.histogram(values, edges)[0] / len(values)
            axes.stairs(count, edges, fill=True, color=color, alpha=0.2 if compared else 0.75)
            if compared:
                axes.stairs(count, edges, color=color, linewidth=1.4)
            axes.axvline(float(np.median(values)), color=color if compared else INK, linewidth=1.2, linestyle=dash)
    axes.set(xlim=(edges[0], edges[-1]), ylim=(0, None))
    if edges[-1] == 180.0:
        axes.set_xticks([0, 45, 90, 135, 180])
    _caption(axes, samples, edges)


def _caption(axes: Axes, samples: Sequence[Array], edges: Array) -> None:
    """Above a histogram: medians, and how much of it lies beyond the axis."""
    medians = [three_digits(float(np.median(values))) if len(values) else "not defined" for values in samples]
    colors = COLORS if len(samples) > 1 else (INK,)
    words = [("median", MUTED), *zip(medians, colors, strict=False)]
    beyond = max(float(((values < edges[0]) | (values > edges[-1])).mean()) for values in samples if len(values))
    if beyond >= 0.0005:
        words.append((f"  {100 * beyond:.1f} % lie beyond", MUTED))
    place: Any = ((0, 1.0), "axes fraction")
    for text, color in words:
        written = axes.annotate(
            text, place[0], xycoords=place[1], xytext=(5, 0) if text != "median" else (0, 6),
            textcoords="offset points", fontsize=8.5, color=color, va="bottom",
            weight="bold" if color in COLORS else "normal",
        )  # fmt: skip
        place = ((1, 0), written)  # the next one stands to its right


def _range(key: str, samples: Sequence[Array]) -> tuple[float, float]:
    """Where an axis begins and ends: all strokes but the ``TAIL_SHARE`` at the long end."""
    high = MEASURES[key].high
    if high < math.inf:
        low = 0.0 if key in FULL_RANGE else min(float(np.quantile(values, TAIL_SHARE)) for values in samples)
        return min(math.floor(20 * low) / 20, 0.95), high
    return 0.0, max(float(np.quantile(values, 1 - TAIL_SHARE)) for values in samples) or 1.0
