"""Find the settings that are worth their time: the Pareto fronts of seconds against PSNR and perceptual distance."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from brushexp.contracts.files import write_text
from brushexp.contracts.results import (
    csv_table,
    escape_markdown,
    markdown_table,
    over_seeds,
    quantities,
    remark_on_provenance,
)
from brushexp_studies import plotting
from brushexp_studies.plotting import COLORS, GREY, INK

FRONTS = ("psnr", "perceptual")  # metrics that have a front
FLAGS = ["front_psnr", "front_perceptual"]
COLUMNS = ["picture", "number", "seconds", *FRONTS, "runs", *FLAGS, "overrides", "command"]
HEIGHT = 6.0  # inches: of the panels of an image
MOST_IMAGES = 6  # in the plot; the tables have all
SHORTEST_SECONDS = 0.01  # seconds: a logarithmic axis has no 0
MOST_LINES, LINE = 20, 42  # settings in the list beside the panels, and letters of a line
DIGITS = {"seconds": 2, "psnr": 2, "perceptual": 4}


def front(costs: Any) -> np.ndarray:
    """Tell which of some pairs of costs are on the Pareto front: no other is as low in both and lower in one."""
    costs = np.asarray(costs, float)
    as_low = (costs[:, None] <= costs[None]).all(-1)
    lower = (costs[:, None] < costs[None]).any(-1)
    return ~(as_low & lower).any(0)


def front_table(frame: pd.DataFrame) -> pd.DataFrame:
    """Tabulate ``COLUMNS``: the settings of every image with at least two, by seconds; values are means over seeds."""
    means = over_seeds(frame)
    table = means["mean"].reindex(columns=["seconds", *FRONTS]).join(means["run"]).dropna(subset=["seconds", "psnr"])
    table = table.rename_axis(["picture", "overrides"]).reset_index()
    parts = []
    for _, settings in table.groupby("picture", sort=False):
        if len(settings) > 1:
            one = settings.sort_values("seconds", kind="stable")
            distance = one["perceptual"].fillna(math.inf)
            one["number"] = range(1, len(one) + 1)
            one["front_psnr"] = front(one[["seconds"]].assign(cost=-one["psnr"]))
            one["front_perceptual"] = front(one[["seconds"]].assign(cost=distance)) & (distance < math.inf)
            parts.append(one)
    return (pd.concat(parts) if parts else table.iloc[:0]).reindex(columns=COLUMNS)


def write_front(folder: Path, frame: pd.DataFrame) -> Path | None:
    """Write ``pareto.md``, ``.csv`` and ``.png``, and return the first; None without two settings of an image."""
    table = front_table(frame)
    if table.empty:
        return None
    lines = ["Seconds of optimisation, means over seeds. On a front: nothing else is as fast and as good."]
    if remark := remark_on_provenance(frame):
        lines += ["", escape_markdown(remark)]
    for image, points in table.groupby("picture", sort=False):
        rows = points[["number", "seconds", *FRONTS, "runs"]].rename(columns={"number": ""})
        rows["front"] = [", ".join(np.compress(flags, FRONTS)) for flags in points[FLAGS].to_numpy(bool)]
        rows["overrides"] = points["overrides"]
        commands = [f"{number:>4}: {text}" for number, text in _on_a_front(points, "command")]
        lines += ["", f"## {image}", "", markdown_table(rows, DIGITS), ""]
        lines += ["Those on a front are repeated by", "", "```", *commands, "```"]
    write_text(folder / "pareto.md", "\n".join([*lines, ""]))
    write_text(folder / "pareto.csv", csv_table(table))
    plotting.save_figure(_plot(table, folder), folder / "pareto.png")
    return folder / "pareto.md"


def _on_a_front(points: pd.DataFrame, column: str) -> list[tuple[int, str]]:
    """List the numbers of the settings on a front, with a column of theirs."""
    return list(points.loc[points[FLAGS].any(axis=1), ["number", column]].itertuples(index=False, name=None))


def _plot(table: pd.DataFrame, folder: Path) -> Figure:
    """Draw a row of two panels for each image, and list the settings on their fronts beside it."""
    images = list(table.groupby("picture", sort=False))[:MOST_IMAGES]
    figure = plotting.new_figure(HEIGHT * len(images))
    grid = figure.subplots(len(images), 3, squeeze=False, width_ratios=(5, 5, 3))
    for panels, (image, points) in zip(grid, images, strict=True):
        for axes, metric in zip(panels[:2], FRONTS, strict=True):
            _panel(axes, points, metric)
        panels[0].set_title(plotting.without_math(image), fontsize=11, loc="left", color=INK)
        lines = [f"{number:>2}  {text}" for number, text in _on_a_front(points, "overrides")]
        lines[MOST_LINES:] = ["more in pareto.md"] * (len(lines) > MOST_LINES)
        text = "\n".join(plotting.label_lines(line, LINE, most=2) for line in lines)
        panels[2].text(0, 1, text, va="top", fontsize=8.5, linespacing=1.3, color=INK, in_layout=False)
        panels[2].axis("off")
    plotting.add_title(figure, folder, "what is worth its time; pareto.md has all settings")
    return figure


def _panel(axes: Axes, points: pd.DataFrame, metric: str) -> None:
    """Draw all points, and the numbered front of one metric, near which the axis ends."""
    plotting.tidy(axes)
    axes.set(xlabel="optimisation, s", ylabel=quantities()[metric].label)
    points = points.dropna(subset=[metric])
    if points.empty:
        axes.text(0.5, 0.5, "not measured", transform=axes.transAxes, ha="center", color=GREY)
        return
    seconds, values, first = points["seconds"].clip(lower=SHORTEST_SECONDS), points[metric], points[f"front_{metric}"]
    best = values[first]
    axes.plot(seconds[~first], values[~first], "o", color=GREY, markersize=4)
    axes.step(
        [*seconds[first], seconds.max()], [*best, best.iloc[-1]], where="post", color=COLORS[0],
        marker="o", markevery=list(range(len(best))),
    )  # fmt: skip
    plotting.fit_scale(axes, "x", seconds)
    below, above = (1.0, 0.1) if metric == "psnr" else (0.1, 1.0)  # more room where settings are worse
    if (span := np.ptp(best)) > 0:
        axes.set_ylim(best.min() - below * span, best.max() + above * span)
    aside: Any = {"xytext": (-4, 3 if metric == "psnr" else -11), "textcoords": "offset points", "ha": "right"}
    for number, x, y in zip(points["number"][first], seconds[first], best, strict=True):
        axes.annotate(str(number), (x, y), fontsize=9, color=INK, **aside)
