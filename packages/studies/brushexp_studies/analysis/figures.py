"""Draw a figure that shows the brushwork of one painting, or of two paintings with the same axes."""

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import SubFigure
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from skimage.color import lab2rgb
from torch import Tensor

from brushexp.contracts.members import Analytic, Tiled
from brushexp.contracts.results import DIRECTION_BINS, MEASURES, Array, direction_shares
from brushexp.contracts.strokes import NEIGHBOURS, centre_of, curve_of, direction_of, mean_direction, nearest_strokes
from brushexp_studies.analysis.summary import OVERALL, Analysis
from brushexp_studies.analysis.summary_text import overall_texts, relative_unit, setters_of, strokes_in, three_digits
from brushexp_studies.plotting import COLORS, FAINT, INK, new_figure, save_figure, tidy, without_math

PRINT_DPI = 200  # dots per inch; sharp on paper
HEIGHT = 5.2  # height in inches of a painting with its rose, and of the histograms
MAP_CELLS = 160  # number of places along the longer side at which coherence is computed
DASHES = 26  # number of flow lines along the longer side
SCALE_SHARE = 0.6  # share of a colour map that is used; lines would be invisible on darker colours
PANELS = ("length", "width", "straightness", "curvature", "elongatedness", "visible", "coherence", "homogeneity")
FULL_RANGE = ("curvature", "visible", "coherence")  # measures whose axis covers their whole range
TAIL_SHARE = 0.02  # share of strokes that a panel may leave out at its long tail
HISTOGRAM_BINS = 32
RINGS = (0.05, 0.1, 0.2, 0.5, 1.0)  # shares of strokes by direction
NUMBERS = ("direction", "agreement", "coherence", "disorder", "entropy", "layers", "hidden")  # below the rose
MUTED = "#6a6a6a"
LABEL_LENGTH = 44  # maximum length of an axis label in letters
STROKES_SIDE = 900  # longer side of the drawn strokes in pixels
LEAST_AROUND = 3  # minimum number of strokes around a place that define a coherence
CHROMA, LIGHTNESS, LIGHTNESS_SPAN = 32.0, 64.0, 12.0  # colours of directions in CIE LCh; larger values leave sRGB
LEVEL_HUE = math.radians(85)  # horizontal strokes are ochre, vertical strokes blue


def write_figure(path: Path, analyses: Sequence[Analysis]) -> Path:
    """Write a PNG with a map of directions, a coherence map and a rose diagram per painting, and with histograms."""
    figure = new_figure(HEIGHT * (len(analyses) + 1))
    figure.set_dpi(PRINT_DPI)
    *parts, panels = figure.subfigures(len(analyses) + 1, 1, squeeze=False)[:, 0]
    largest = max(float(direction_shares(one.values("orientation")).max()) for one in analyses)
    for part, one, color in zip(parts, analyses, COLORS, strict=False):
        _painting(part, one, color if len(analyses) > 1 else INK, largest)
    for axes, key in zip(panels.subplots(2, 4).flat, PANELS, strict=True):
        _histogram(axes, key, analyses)
    return save_figure(figure, path)


def _painting(part: SubFigure, analysis: Analysis, ink: str, largest: float) -> None:
    heading = (
        f"{without_math(analysis.name)[:60]}: {strokes_in(analysis)} on {analysis.size[1]} x {analysis.size[0]} px"
    )
    heading += f"; a pitch between neighbours is {three_digits(analysis.pitch)} px"
    part.suptitle(heading, x=0.01, ha="left", fontsize=12, color=ink)
    axes: dict[str, Any] = part.subplot_mosaic(
        [["strokes", "coherence", "rose"], ["strokes", "coherence", "numbers"]], width_ratios=(5, 5, 3),
        height_ratios=(3, 1.3), per_subplot_kw={"rose": {"projection": "polar"}},
    )  # fmt: skip
    extent = (0, analysis.size[1], analysis.size[0], 0)
    axes["strokes"].imshow(stroke_map(analysis), extent=extent, interpolation="antialiased")
    axes["strokes"].set_title("strokes coloured by direction", fontsize=10)
    _coherence(axes["coherence"], part, analysis)
    axes["coherence"].set_title(f"coherence of the directions of the {NEIGHBOURS} nearest strokes", fontsize=10)
    for picture in (axes["strokes"], axes["coherence"]):
        picture.set(xticks=[], yticks=[], anchor="N")
        picture.spines[:].set_color(ink)
    _rose(axes["rose"], analysis, largest)
    axes["rose"].set_title("directions, clockwise; dotted: all equally frequent", fontsize=10)
    look = {"va": "top", "fontsize": 8.5, "linespacing": 1.5, "in_layout": False}
    axes["numbers"].text(0.1, 1, "\n".join(OVERALL[key].name for key in NUMBERS), color=MUTED, **look)
    axes["numbers"].text(0.75, 1, "\n".join(overall_texts(analysis, NUMBERS)), color=INK, **look)
    axes["numbers"].axis("off")


def _coherence(axes: Axes, part: SubFigure, analysis: Analysis) -> None:
    """Draw a map of the coherence of directions, with lines along the strokes whose length indicates the coherence."""
    colors = ListedColormap(colormaps["YlGnBu"](np.linspace(0, SCALE_SHARE, 256)))
    coherence = np.linalg.norm(coherence_map(analysis, MAP_CELLS)[1], axis=-1)
    place = (0, analysis.size[1], analysis.size[0], 0)
    image = axes.imshow(coherence, extent=place, cmap=colors, vmin=0, vmax=1, interpolation="bilinear")
    axes.set_facecolor(FAINT)  # visible where strokes are too few
    points, mean = coherence_map(analysis, DASHES)
    length = 0.94 * max(analysis.size) / DASHES * np.hypot(mean[..., 0], mean[..., 1])
    way = 0.5 * np.arctan2(mean[..., 1], mean[..., 0])
    axes.quiver(
        points[..., 0], points[..., 1], length * np.cos(way), length * np.sin(way), color=INK, width=0.003,
        pivot="middle", angles="xy", scale_units="xy", scale=1, headwidth=0, headlength=0, headaxislength=0,
    )  # fmt: skip
    scale = part.colorbar(image, ax=axes, shrink=0.5, panchor=False)
    scale.set_ticks([0, 0.5, 1], labels=["0 disorder", "0.5", "1 parallel"], fontsize=8)


def _rose(axes: Any, analysis: Analysis, largest: float) -> None:
    """Draw the fraction of strokes in each direction as the area of two opposite bars."""
    share = np.sqrt(direction_shares(analysis.values("orientation")))
    middle = np.arange(DIRECTION_BINS) * math.pi / DIRECTION_BINS
    look = {"color": direction_colors(middle), "edgecolor": "white", "linewidth": 0.6}
    for way in (middle, middle + math.pi):
        axes.bar(way, share, math.pi / DIRECTION_BINS, **look)
    axes.plot(np.linspace(0, 2 * math.pi, 200), np.full(200, DIRECTION_BINS**-0.5), ":", color=INK, linewidth=1)
    top = max(largest, 1.3 / DIRECTION_BINS)
    rings = [ring for ring in RINGS if ring <= top]
    axes.set_theta_direction(-1)
    axes.set_ylim(0, math.sqrt(top) * 1.03)
    axes.set_yticks(np.sqrt(rings), [f"{ring:.0%}" for ring in rings], fontsize=7.5)
    axes.set_xticks(np.arange(8) * math.pi / 4, [f"{45 * k % 180}°" for k in range(8)], fontsize=9)
    axes.tick_params(pad=-1)
    axes.grid(color=FAINT, linewidth=0.6)
    axes.spines["polar"].set_visible(False)


def _histogram(axes: Axes, key: str, analyses: Sequence[Analysis]) -> None:
    """Draw a histogram and the median of one measure, in units of the pitch if paintings are compared."""
    tidy(axes)
    axes.grid(axis="x", visible=False)
    axes.yaxis.set_major_formatter("{x:g} %")
    compared = len(analyses) > 1
    samples = [one.relative(key) if compared else one.values(key) for one in analyses]
    unit = relative_unit(key) if compared else MEASURES[key].unit
    label, setters = MEASURES[key].name + f", {unit}" * bool(unit), setters_of(key, analyses)
    filled = [
        (values, color, dash) for values, color, dash in zip(samples, COLORS, ("-", "--"), strict=False) if len(values)
    ]
    if not filled:
        axes.set_xlabel(f"{label}: not defined")
        return
    low, high = _range(key, [values for values, _, _ in filled])
    for values, color, dash in filled:
        weights, median = np.full(len(values), 100 / len(values)), float(np.median(values))
        look: Any = {"histtype": "stepfilled", "facecolor": (color, 0.25), "edgecolor": color}
        axes.hist(values, HISTOGRAM_BINS, range=(low, high), weights=weights, **look)
        axes.axvline(median, color=color, linewidth=1.2, linestyle=dash, label=f"median {three_digits(median)}")
    beyond = max(float(((values < low) | (values > high)).mean()) for values, _, _ in filled)
    axes.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=2, fontsize=8.5, frameon=False, borderaxespad=0)
    label += f" ({beyond:.1%} lie beyond)" * (beyond >= 0.0005)
    axes.set(xlabel=label + f"\nset by {without_math(setters)[:LABEL_LENGTH]}" * bool(setters), xlim=(low, high))


def _range(key: str, samples: Sequence[Array]) -> tuple[float, float]:
    """Choose an axis range that includes all strokes except a fraction ``TAIL_SHARE`` in the long tail."""
    high = MEASURES[key].high
    if high < math.inf:
        low = 0.0 if key in FULL_RANGE else min(float(np.quantile(values, TAIL_SHARE)) for values in samples)
        return min(math.floor(20 * low) / 20, 0.95), high
    return 0.0, max(float(np.quantile(values, 1 - TAIL_SHARE)) for values in samples) or 1.0


def direction_colors(angle: Array) -> Array:
    """Map directions in radians to colours (N, 3): half a turn runs through all hues, and NaN is grey."""
    finite, turn = np.isfinite(angle), 2 * np.nan_to_num(angle)
    lightness = LIGHTNESS + LIGHTNESS_SPAN * np.where(finite, np.cos(turn), 0.0)
    chroma = np.where(finite, CHROMA, 0.0) * np.array([np.cos(turn + LEVEL_HUE), np.sin(turn + LEVEL_HUE)])
    return np.clip(lab2rgb(np.stack([lightness, *chroma], axis=-1)), 0, 1)


@torch.no_grad()
def stroke_map(analysis: Analysis) -> NDArray[np.float32]:
    """Draw the strokes on white, coloured by direction, as a picture (H, W, 3)."""
    zoom = STROKES_SIDE / max(analysis.size)
    size = (max(1, round(analysis.size[0] * zoom)), max(1, round(analysis.size[1] * zoom)))
    color = torch.from_numpy(direction_colors(analysis.measures.orientation)).float()
    strokes = replace(analysis.strokes.map(Tensor.float), color=color, drift=torch.zeros_like(color)).moved(zoom=zoom)
    above = torch.from_numpy(analysis.depth).argsort(descending=True)
    return Tiled()(Analytic()(strokes), above, size, torch.ones(3)).image.numpy().transpose(1, 2, 0).clip(0, 1)


@torch.no_grad()
def coherence_map(analysis: Analysis, cells: int) -> tuple[Array, Array]:
    """Compute a grid of points (h, w, 2) in pixels, and the mean doubled direction (h, w, 2) of the nearest strokes.

    ``cells`` is the number of points along the longer side. The length of a mean vector is the coherence. The vector
    is NaN where fewer than ``LEAST_AROUND`` strokes are within the analysis radius.
    """
    height, width = analysis.size
    step = max(height, width) / cells
    columns, rows = max(1, round(width / step)), max(1, round(height / step))
    x, y = (np.arange(columns) + 0.5) * width / columns, (np.arange(rows) + 0.5) * height / rows
    points = np.stack(np.meshgrid(x, y), axis=-1)
    curve = curve_of(analysis.strokes.map(Tensor.double))
    centre, places = centre_of(curve), torch.from_numpy(points.reshape(-1, 2))
    mean = mean_direction(direction_of(curve), nearest_strokes(places, centre, exclude_self=False)).numpy()
    near = cKDTree(centre.numpy()).query_ball_point(places.numpy(), analysis.radius, return_length=True)
    mean[near < LEAST_AROUND] = np.nan
    return points, mean.reshape(rows, columns, 2)
