"""Painters of a leaderboard against time: the mean PSNR of the same pictures, with its interval."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from brushexp.reporting import plotting
from brushexp.reporting.plotting import COLORS, DASHES, INK, SIZE
from brushexp.results.paired import CONFIDENCE, interval
from brushexp_thesis.standings import Section, count_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MOST_SECTIONS = 4
FIRST = 0.05  # seconds: of an axis
POINTS = 80  # of a line


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
