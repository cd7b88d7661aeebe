"""What all static plots share: colours, letters, axes. Matplotlib is loaded when one is drawn."""

from __future__ import annotations

import io
import re
import textwrap
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from brushexp.system.files import write_bytes

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Okabe and Ito (2008): told apart by the colour-blind too; without yellow, which is faint on white.
COLORS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
MARKERS = "osD^vPX"
DASHES = ("-", "--", ":", "-.")
INK, FAINT, GREY = "#202020", "#d8d8d8", "#9a9a9a"
DPI = 100
SIZE = (14.0, 5.0)  # inches
LOGARITHMIC_FROM = 20.0  # ratio of largest to smallest number from which an axis is logarithmic


def new_figure(height: float = SIZE[1]) -> Figure:
    """An empty figure on white, of no global state."""
    from matplotlib.figure import Figure  # noqa: PLC0415

    return Figure(figsize=(SIZE[0], height), dpi=DPI, layout="constrained", facecolor="white")


def tidy(axes: Axes) -> None:
    """A light grid and no frame."""
    axes.spines[["top", "right"]].set_visible(False)
    axes.spines[["left", "bottom"]].set_color("#808080")
    axes.grid(color=FAINT, linewidth=0.6)
    axes.set_axisbelow(True)
    axes.tick_params(labelsize=9, color="#808080", labelcolor=INK)


def save_figure(figure: Figure, path: Path) -> Path:
    """Write a PNG, the same for the same figure."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg  # noqa: PLC0415

    encoded = io.BytesIO()
    FigureCanvasAgg(figure).print_png(encoded, metadata={"Software": None})  # figure.savefig draws twice
    write_bytes(path, encoded.getvalue())
    return path


def fit_scale(axes: Axes, name: str, values: Iterable[float]) -> None:
    """A logarithmic axis (x or y) with plain numbers where values are positive and differ much."""
    from matplotlib.ticker import LogLocator, NullLocator, StrMethodFormatter  # noqa: PLC0415

    found = [value for value in values if value == value]  # noqa: PLR0124 (missing ones are NaN)
    if found and min(found) > 0 and max(found) / min(found) > LOGARITHMIC_FROM:
        axes.set(**{f"{name}scale": "log"})
        axis = axes.xaxis if name == "x" else axes.yaxis
        axis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axis.set_major_formatter(StrMethodFormatter("{x:g}"))
        axis.set_minor_locator(NullLocator())


def entitle(figure: Figure, folder: Path, text: str) -> None:
    """Write the name of a sweep's folder and a text above all panels."""
    figure.suptitle(f"{without_math(folder.resolve().name)[:60]}: {text}", fontsize=11, x=0.01, ha="left")


def without_math(text: str) -> str:
    """On one line, with the letters that the font has; a dollar sign begins no formula."""
    from matplotlib.font_manager import FontProperties, findfont, get_font  # noqa: PLC0415

    known = get_font(findfont(FontProperties())).get_charmap()
    return "".join(sign if ord(sign) in known else "?" for sign in " ".join(text.split())).replace("$", r"\$")


def label_lines(text: str, width: int, most: int = 3) -> str:
    """Text of a plot in at most so many lines of so many letters."""
    return folded(without_math(text), width, most)


def folded(text: str, width: int, most: int = 3) -> str:
    """Text in at most so many lines of so many letters, broken at spaces and after signs, if need be in words."""
    marked = re.sub(r"(?<=[+,/_])", "\v", text)  # at which textwrap may break
    filled = textwrap.fill(marked, width, max_lines=most, placeholder="...", replace_whitespace=False)
    return filled.replace("\v", "")
