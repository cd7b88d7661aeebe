"""The plot of paired differences: every picture (or seed) is a letter, at its own height in the row of each setting."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from string import ascii_lowercase, ascii_uppercase
from typing import TYPE_CHECKING

import numpy as np

from brushexp.results import plotting
from brushexp.results.plotting import COLORS, GREY, INK
from brushexp.results.tables import METRICS

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from brushexp.results.paired import Difference

PANELS = (
    "psnr",
    "psnr_alpha",
    "ssim",
    "edges",
    "perceptual",
    "fid_effl0",
    "cpu_seconds",
)  # of these as many as have room
MOST_PANELS = 4
ROW, TALLEST = 0.16, 30.0  # inches: of a letter, of a figure
LETTERS = ascii_uppercase + ascii_lowercase
LABEL = 28  # letters in a line of a label


def write_paired_plot(path: Path, found: Sequence[Difference], title: str) -> Path:
    """Write a PNG with a panel per metric; a bar is the mean with its interval."""
    metrics = [key for key in PANELS if any(one.metric == key for one in found)][:MOST_PANELS]
    metrics = metrics or [found[0].metric]
    shown = [one for one in found if one.metric in metrics]
    options = list(dict.fromkeys(one.option for one in shown))
    units = list(dict.fromkeys(unit for one in shown for unit in one.gains))
    figure = plotting.new_figure(min(TALLEST, 2.2 + max(0.6, ROW * (len(units) + 1)) * len(options)))
    panels = figure.subplots(1, len(metrics), squeeze=False, sharey=True)[0]
    for axes, metric in zip(panels, metrics, strict=True):
        plotting.tidy(axes)
        _panel(axes, {one.option: one for one in shown if one.metric == metric}, options, units)
        axes.set_xlabel(
            f"{METRICS[metric].name}\n{'natural log of the ratio, ' * METRICS[metric].ratio}better to the right"
        )
    panels[0].set_yticks(range(len(options)), [plotting.label_lines(option, LABEL) for option in options])
    panels[0].set_ylim(len(options) - 0.5, -0.5)
    reference = plotting.without_math(found[0].reference)
    plotting.entitle(
        figure, path.parent / title, f"against {reference}; letters are {found[0].unit}s, bars their mean and interval"
    )
    names = "   ".join(f"{letter} {plotting.without_math(unit)}" for letter, unit in zip(LETTERS, units, strict=False))
    figure.supxlabel(plotting.folded(names, 150, most=6), fontsize=9, color=INK)
    return plotting.save_figure(figure, path)


def _panel(axes: Axes, rows: dict[str, Difference], options: Sequence[str], units: Sequence[str]) -> None:
    axes.axvline(0, color=GREY, linewidth=1)
    axes.locator_params(axis="x", nbins=4)
    heights = 0.8 * (np.arange(len(units)) + 0.5) / len(units) - 0.4
    for row, option in enumerate(options):
        if option not in rows:
            continue
        one = rows[option]
        if np.isfinite(one.low):
            axes.fill_betweenx([row - 0.42, row + 0.42], one.low, one.high, color=COLORS[0], alpha=0.16, linewidth=0)
        axes.plot([one.mean, one.mean], [row - 0.42, row + 0.42], color=COLORS[0], linewidth=1.6)
        for k, unit in enumerate(units):
            if unit in one.gains:
                letter = LETTERS[k % len(LETTERS)]
                axes.plot(
                    one.gains[unit], row + heights[k], marker=rf"$\mathrm{{{letter}}}$", color=INK, markersize=5.5
                )
