"""Write what was measured as CSV, XLSX, JSON, Markdown and LaTeX, and drawn as PDF."""

import io
import logging
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from brushexp_studies.plotting import COLORS, INK, new_figure, tidy, without_math

from brushexp.reporting.tables import csv_table, latex_table, markdown_table
from brushexp.results.stroke_table import DIRECTION_BINS, direction_shares
from brushexp.system.files import write_bytes, write_json, write_text
from brushexp_recovery.measure import KINDS, Interval, is_apart
from brushexp_recovery.stroke_rows import Rows, table_with_units

log = logging.getLogger(__name__)

Figures = Mapping[str, Mapping[str, Interval]]  # of each region or painting, by `KINDS`

DIRECTIONS = "Directions run clockwise from level: 45° falls to the right."
MEANING = (
    "Each figure is the median over the photograph and small changes of it (scale, turn, compression, tone), in each "
    "of which strokes are drawn by their confidence; 95 % of these draws lie between low and high. Errors that "
    "recovery makes in every view are not in the interval."
)
APART = "The first painting less the second: a figure is apart if the interval of its difference leaves out 0."
PANELS = ("length", "width", "elongatedness", "curvature")
BINS = 30
TAIL = 0.99  # quantile at which the axis of a histogram ends


def figure_rows(figures: Figures, mm: float | None) -> list[dict[str, Any]]:
    """List figures with their intervals and spreads, a row each."""
    return [
        {
            "of": of, "measure": kind.name, "unit": kind.unit_in(mm), "value": digits(one.value),
            "low": digits(one.low), "high": digits(one.high), "sd over strokes": digits(one.over_strokes),
            "sd over views": digits(one.over_views),
        }
        for of, intervals in figures.items()
        for kind, one in ((KINDS[name], interval) for name, interval in intervals.items())
    ]  # fmt: skip


def difference_rows(differences: Mapping[str, Interval], mm: float | None) -> list[dict[str, Any]]:
    """List differences of two paintings, and whether their intervals leave out 0."""
    return [
        {
            "measure": KINDS[name].name, "unit": KINDS[name].unit_in(mm), "apart": "yes" if is_apart(one) else "no",
            "difference": digits(one.value), "low": digits(one.low), "high": digits(one.high),
        }
        for name, one in differences.items()
    ]  # fmt: skip


def digits(value: float) -> str | None:
    """Write a number with three digits, and with five decimals at most; None for one that is not defined."""
    if not math.isfinite(value):
        return None
    tiny = 0 < abs(value) < 0.001
    return f"{value:.0f}" if abs(value) >= 1000 else f"{value:.5f}" if tiny else f"{value:.3g}"


def write_measures(
    folder: Path, rows: Rows, figures: Figures, differences: Mapping[str, Interval] | None, both_mm: float | None
) -> list[Path]:
    """Write all tables and drawings; ``both_mm`` is set if differences are in millimetres."""
    tables = {"measures": figure_rows(figures, rows.mm)}
    if differences is not None:
        tables["differences"] = difference_rows(differences, both_mm)
    strokes = table_with_units(rows)
    write_text(folder / "strokes.csv", csv_table(strokes, significant=6))
    paths = [folder / "strokes.csv"]
    text = [f"{MEANING} {DIRECTIONS}"]
    for name, table in tables.items():
        write_text(folder / f"{name}.csv", csv_table(table))
        write_text(folder / f"{name}.tex", latex_table(table))
        text += [f"## {name.capitalize()}", markdown_table(table)]
        paths += [folder / f"{name}.csv", folder / f"{name}.tex"]
    write_text(folder / "measures.md", "\n\n".join(text) + "\n")
    write_json(folder / "measures.json", json_of(figures, differences, rows.mm))
    write_drawings(folder / "measures.pdf", rows)
    paths += [folder / f"measures.{suffix}" for suffix in ("md", "json", "pdf")]
    return paths + _xlsx(folder, strokes, tables)


def json_of(figures: Figures, differences: Mapping[str, Interval] | None, mm: float | None) -> dict[str, Any]:
    """Collect figures as plain data."""
    data: dict[str, Any] = {"mm_per_px": mm, "directions": DIRECTIONS, "interval": 0.95}
    for of, intervals in figures.items():
        data.setdefault("measures", {})[of] = {
            name: {"unit": KINDS[name].unit_in(mm), **vars(one)} for name, one in intervals.items()
        }
    if differences is not None:
        data["differences"] = {name: {**vars(one), "apart": is_apart(one)} for name, one in differences.items()}
    return data


def _xlsx(folder: Path, strokes: Mapping[str, Any], tables: Mapping[str, Any]) -> list[Path]:
    """Write all tables as sheets of one workbook, if openpyxl is there."""
    import pandas as pd  # noqa: PLC0415  (slow to import)

    memory = io.BytesIO()
    try:
        with pd.ExcelWriter(memory, engine="openpyxl") as book:
            for name, table in tables.items():
                numbers = [{key: number_or_text(value) for key, value in row.items()} for row in table]
                pd.DataFrame(numbers).to_excel(book, sheet_name=name, index=False)
            pd.DataFrame(strokes).to_excel(book, sheet_name="strokes", index=False)
    except ImportError:
        log.warning("no measures.xlsx: openpyxl is missing, pip install 'brushexp[xlsx]'")
        return []
    write_bytes(folder / "measures.xlsx", memory.getvalue())
    return [folder / "measures.xlsx"]


def number_or_text(value: Any) -> Any:
    """Turn what reads as a number into one, for sheets that calculate."""
    try:
        return float(value)
    except (TypeError, ValueError):
        return value


def write_drawings(path: Path, rows: Rows) -> None:
    """Draw histograms weighted by confidence, and the rose, as vectors on a page."""
    from matplotlib.backends.backend_pdf import FigureCanvasPdf  # noqa: PLC0415  (slow to import)

    figure = new_figure(4.6)
    axes = figure.subplot_mosaic(
        [["rose", *PANELS[:2]], ["rose", *PANELS[2:]]], per_subplot_kw={"rose": {"projection": "polar"}}
    )
    for name in PANELS:
        draw_histogram(axes[name], rows, name)
    draw_rose(axes["rose"], rows)
    figure.suptitle(f"{len(rows):,} strokes, weighted by their confidence. {DIRECTIONS}", fontsize=10)
    memory = io.BytesIO()
    FigureCanvasPdf(figure).print_pdf(memory, metadata={"CreationDate": None, "Producer": None, "Creator": "brushexp"})
    write_bytes(path, memory.getvalue())


def draw_histogram(axes: Any, rows: Rows, name: str) -> None:
    """Draw how many strokes have which length, width or other column."""
    tidy(axes)
    values, unit = rows.columns[name], {"length": "px", "width": "px", "curvature": "°"}.get(name, "")
    if rows.mm is not None and unit == "px":
        values, unit = values * rows.mm, "mm"
    end = float(np.quantile(values, TAIL)) if len(values) else 1.0
    look = {"facecolor": COLORS[0], "edgecolor": "white", "linewidth": 0.4}
    axes.hist(np.minimum(values, end), BINS, range=(0, end or 1.0), weights=rows.columns["confidence"], **look)
    axes.set(xlabel=without_math(name + f", {unit}" * bool(unit)), ylabel="strokes")


def draw_rose(axes: Any, rows: Rows) -> None:
    """Draw shares of the strokes' length by direction, clockwise, each both ways."""
    weight = rows.columns["length"] * rows.columns["confidence"]
    share = np.sqrt(direction_shares(rows.columns["direction"], weight))
    middle = np.arange(DIRECTION_BINS) * math.pi / DIRECTION_BINS
    for way in (middle, middle + math.pi):
        axes.bar(way, share, math.pi / DIRECTION_BINS, color=COLORS[0], edgecolor="white", linewidth=0.4)
    axes.set_theta_direction(-1)
    axes.set_xticks(np.arange(8) * math.pi / 4, [f"{45 * k % 180}°" for k in range(8)], color=INK, fontsize=9)
    axes.set_yticks([])
    axes.set_title("direction, share of the length", fontsize=10)
