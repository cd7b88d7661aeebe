"""Helpers for static plots: colours, text, axes and strips of points."""

import io
import math
import re
import textwrap
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties, findfont, get_font
from matplotlib.ticker import LogLocator, NullLocator, StrMethodFormatter
from pandas import DataFrame

from brushexp.contracts.files import write_bytes

# Colours that colour-blind people can distinguish (Okabe and Ito, 2008), without yellow, which is faint on white.
COLORS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
MARKERS = "osD^vPX"
DASHES = ("-", "--", ":", "-.")
INK, FAINT, GREY = "#202020", "#d8d8d8", "#9a9a9a"
DPI = 100
FIGURE_SIZE = (14.0, 5.0)  # inches
TALLEST = 30.0  # maximum height in inches of a figure that grows with its rows
LABEL = 28  # letters per line of a row's label
LOGARITHMIC_FROM = 20.0  # ratio of largest to smallest number above which an axis is logarithmic


def new_figure(height: float = FIGURE_SIZE[1]) -> Figure:
    """Create an empty figure on white, without using Matplotlib's global state."""
    return Figure(figsize=(FIGURE_SIZE[0], height), dpi=DPI, layout="constrained", facecolor="white")


def tidy(axes: Axes) -> None:
    """Give axes a light grid, and remove their top and right spines."""
    axes.spines[["top", "right"]].set_visible(False)
    axes.spines[["left", "bottom"]].set_color("#808080")
    axes.grid(color=FAINT, linewidth=0.6)
    axes.set_axisbelow(True)
    axes.tick_params(labelsize=9, color="#808080", labelcolor=INK)


def save_figure(figure: Figure, path: Path) -> Path:
    """Write a figure as a PNG file; equal figures give byte-identical files."""
    file = io.BytesIO()
    FigureCanvasAgg(figure).print_png(file, metadata={"Software": None})  # figure.savefig draws twice
    write_bytes(path, file.getvalue())
    return path


def draw_strips(axes: Axes, table: DataFrame, looks: Sequence[Any], bars: DataFrame | None = None) -> None:
    """Draw a strip of points for each row of a table, with one line of points per column; ``bars`` are error bars."""
    for k, look in enumerate(looks):
        places = np.arange(len(table)) + 0.8 * ((k + 0.5) / len(looks) - 0.5)
        axes.errorbar(table.iloc[:, k], places, xerr=None if bars is None else bars.iloc[:, k], ls="none", **look)
    axes.set_yticks(range(len(table)), [label_lines(name, LABEL) for name in table.index])
    axes.set_ylim(len(table) - 0.5, -0.5)


def fit_scale(axes: Axes, name: str, values: Iterable[float]) -> None:
    """Make an axis (x or y) logarithmic, with plain tick labels, if its values are positive and span a wide range."""
    finite = [value for value in values if math.isfinite(value)]
    if finite and min(finite) > 0 and max(finite) / min(finite) > LOGARITHMIC_FROM:
        axes.set(**{f"{name}scale": "log"})
        axis = axes.xaxis if name == "x" else axes.yaxis
        axis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axis.set_major_formatter(StrMethodFormatter("{x:g}"))
        axis.set_minor_locator(NullLocator())


def add_title(figure: Figure, folder: Path, text: str) -> None:
    """Add a title, which consists of the sweep's folder name and a text, above all panels."""
    figure.suptitle(f"{without_math(folder.resolve().name)[:60]}: {text}", fontsize=11, x=0.01, ha="left")


def without_math(text: str) -> str:
    """Put text on one line, replace characters that the font lacks with "?", and escape dollar signs."""
    letters = get_font(findfont(FontProperties())).get_charmap()
    return "".join(sign if ord(sign) in letters else "?" for sign in " ".join(text.split())).replace("$", r"\$")


def label_lines(text: str, width: int, most: int = 3) -> str:
    """Break a plot label into at most ``most`` lines of ``width`` characters."""
    return wrap_text(without_math(text), width, most)


def wrap_text(text: str, width: int, most: int = 3) -> str:
    """Break text into at most ``most`` lines of ``width`` characters, at spaces, after punctuation, or within words."""
    marked = re.sub(r"(?<=[+,/_])", "\v", text)  # textwrap may break lines at these places
    filled = textwrap.fill(marked, width, max_lines=most, placeholder="...", replace_whitespace=False)
    return filled.replace("\v", "")
