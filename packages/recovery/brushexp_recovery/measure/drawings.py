"""Draw histograms of recovered strokes and a rose diagram of their directions as vector graphics on one page."""

import io
import math
from pathlib import Path
from typing import Any

import numpy as np
from brushexp_studies.plotting import COLORS, INK, new_figure, tidy, without_math

from brushexp.contracts.files import write_bytes
from brushexp.contracts.results import DIRECTION_BINS, direction_shares
from brushexp_recovery.measure.figure_tables import DIRECTIONS
from brushexp_recovery.measure.stroke_table import StrokeTable

PANELS = ("length", "width", "elongatedness", "curvature")
UNITS = {"length": "px", "width": "px", "curvature": "°"}
BINS = 30
TAIL = 0.99  # quantile at which the axis of a histogram ends


def write_drawings(path: Path, strokes: StrokeTable) -> None:
    """Draw confidence-weighted histograms and the rose diagram of directions, and write them to a PDF."""
    from matplotlib.backends.backend_pdf import FigureCanvasPdf  # noqa: PLC0415  (slow to import)

    figure = new_figure(4.6)
    axes = figure.subplot_mosaic(
        [["rose", *PANELS[:2]], ["rose", *PANELS[2:]]], per_subplot_kw={"rose": {"projection": "polar"}}
    )
    for name in PANELS:
        draw_histogram(axes[name], strokes, name)
    draw_rose(axes["rose"], strokes)
    figure.suptitle(f"{len(strokes):,} strokes, weighted by their confidence. {DIRECTIONS}", fontsize=10)
    memory = io.BytesIO()
    FigureCanvasPdf(figure).print_pdf(memory, metadata={"CreationDate": None, "Producer": None, "Creator": "brushexp"})
    write_bytes(path, memory.getvalue())


def draw_histogram(axes: Any, strokes: StrokeTable, name: str) -> None:
    """Draw a histogram of one column of the stroke table, such as length or width."""
    tidy(axes)
    values, unit = strokes.columns[name], UNITS.get(name, "")
    if strokes.mm is not None and unit == "px":
        values, unit = values * strokes.mm, "mm"
    end = float(np.quantile(values, TAIL)) if len(values) else 1.0
    look = {"facecolor": COLORS[0], "edgecolor": "white", "linewidth": 0.4}
    axes.hist(np.minimum(values, end), BINS, range=(0, end or 1.0), weights=strokes.columns["confidence"], **look)
    axes.set(xlabel=without_math(name + f", {unit}" * bool(unit)), ylabel="strokes")


def draw_rose(axes: Any, strokes: StrokeTable) -> None:
    """Draw two opposite bars per direction, clockwise; their area shows the direction's share of the stroke length."""
    weight = strokes.columns["length"] * strokes.columns["confidence"]
    share = np.sqrt(direction_shares(strokes.columns["direction"], weight))
    middle = np.arange(DIRECTION_BINS) * math.pi / DIRECTION_BINS
    for way in (middle, middle + math.pi):
        axes.bar(way, share, math.pi / DIRECTION_BINS, color=COLORS[0], edgecolor="white", linewidth=0.4)
    axes.set_theta_direction(-1)
    axes.set_xticks(np.arange(8) * math.pi / 4, [f"{45 * k % 180}°" for k in range(8)], color=INK, fontsize=9)
    axes.set_yticks([])
    axes.set_title("direction, share of the length", fontsize=10)
