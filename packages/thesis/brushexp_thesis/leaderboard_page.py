"""``report.html`` of a leaderboard: tables that sort, quality against time, and all paintings."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from pathlib import Path, PurePath
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

import numpy as np

from brushexp.pages.html import page
from brushexp.pages.sweep_page import side_for, thumbnail
from brushexp.reporting import plotting
from brushexp.reporting.plotting import COLORS, DASHES, INK, SIZE
from brushexp.results.paired import CONFIDENCE, interval
from brushexp.system.files import write_text
from brushexp_thesis.published import PublishedFigures
from brushexp_thesis.standings import COLUMNS, Row, Section, count_of
from brushexp_thesis.standings_tables import (
    ELSEWHERE,
    EQUAL_SECONDS,
    EXPLAINED,
    at_equal_seconds,
    published_cells,
    table_cells,
    without_empty,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

TEMPLATES = Path(__file__).with_name("templates")
PLOT_SIDE = 1400  # pixels
MOST_SECTIONS = 4
FIRST = 0.05  # seconds: of an axis
POINTS = 80  # of a line


def write_leaderboard_page(
    folder: Path, sections: Sequence[Section], elsewhere: Sequence[PublishedFigures], note: str = ""
) -> Path:
    """Write ``report.html``, with the plot beside it; each picture is shown in the first section that has it."""
    home = {target: section for section in reversed(sections) for target in section.pictures}
    side = side_for(sum((1 + len(section.rows)) for section in home.values()))
    html = page(
        "leaderboard.html.j2",
        TEMPLATES,
        title="Leaderboard",
        note=note,
        plot=thumbnail(folder / "anytime.png", PLOT_SIDE),
        explained=EXPLAINED.replace("*", ""),
        sections=[
            {
                "title": section.title,
                "short": section.title.partition(":")[0],
                "cells": without_empty(table_cells(section)),
                "seconds": at_equal_seconds(section),
                "paintings": list(_paintings(folder, section, home, side)),
            }
            for section in sections
        ],
        equal_seconds=EQUAL_SECONDS,
        elsewhere=without_empty([published_cells(one, one.of.pictures) for one in elsewhere]),
        elsewhere_explained=ELSEWHERE,
        better={metric.name: metric.better for metric in COLUMNS.values()},
        words=("painter", "settings", "pictures"),
    )
    write_text(folder / "report.html", html)
    return folder / "report.html"


def _paintings(folder: Path, section: Section, home: dict[str, Section], side: int) -> Iterator[dict[str, Any]]:
    """Of each picture that belongs to a section: its target, and what every row made of it."""
    for k, (target, name) in enumerate(section.pictures.items()):
        if home[target] is section:
            picture = thumbnail(section.rows[0].entries[k].folder / "target.png", side)
            shown = [{"name": "target", "picture": picture}, *(_painting(folder, row, k, side) for row in section.rows)]
            yield {"name": name, "shown": [one for one in shown if one["picture"]]}


def _painting(folder: Path, row: Row, k: int, side: int) -> dict[str, Any]:
    entry = row.entries[k]
    report = entry.folder / "report.html"
    address = quote(PurePath(os.path.relpath(report, folder.resolve())).as_posix(), errors="surrogateescape")
    strokes = "" if entry.strokes is None else f", {count_of(entry.strokes)} strokes"
    return {
        "name": row.label,
        "caption": f"{row.numbers['psnr'][k]:.2f} dB{strokes}",
        "report": address if report.is_file() else "",
        "command": entry.command,
        "picture": thumbnail(entry.folder / "painting.png", side),
    }


def write_standings_plot(folder: Path, sections: Sequence[Section]) -> Path | None:
    """Write ``anytime.png``; None if no section has two rows with curves."""
    shown = [section for section in sections if section.times][:MOST_SECTIONS]
    if not shown:
        return None
    figure = plotting.new_figure(1.2 * SIZE[1] * len(shown))
    for axes, section in zip(figure.subplots(len(shown), squeeze=False)[:, 0], shown, strict=True):
        _draw_section(axes, section)
    return plotting.save_figure(figure, folder / "anytime.png")


def _draw_section(axes: Axes, section: Section) -> None:
    plotting.tidy(axes)
    rows = [row for row in section.rows if row.curves][: len(COLORS) * len(DASHES)]
    end = max(curve[0][-1] for row in rows for curve in row.curves)
    for k, row in enumerate(rows):
        begin = max(FIRST, *(curve[0][0] for curve in row.curves))
        times = np.geomspace(begin, max(end, begin), POINTS)
        mean, low, high = np.array([interval(row.psnr_at(time)) for time in times]).T
        label = plotting.label_lines(f"{row.label}, {count_of(row.strokes)}", 40)
        axes.plot(times, mean, color=COLORS[k % len(COLORS)], linestyle=DASHES[k // len(COLORS)], label=label)
        if len(row.curves) > 1:
            axes.fill_between(times, low, high, color=COLORS[k % len(COLORS)], alpha=0.06, linewidth=0)
    plotting.fit_scale(axes, "x", [curve[0][-1] for row in rows for curve in row.curves])
    axes.set_title(plotting.without_math(section.title), fontsize=11, loc="left", color=INK)
    axes.set_xlabel("wall time of the optimisation, s; what is done stays", fontsize=10)
    axes.set_ylabel(f"mean PSNR, dB, {CONFIDENCE:.0%} interval", fontsize=10)
    axes.legend(loc="upper left", bbox_to_anchor=(1.01, 1), fontsize=9, frameon=False)
