"""Which settings are worth their time: the Pareto fronts of seconds against PSNR and against perceptual distance."""

from __future__ import annotations

import math
import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from brushexp.results import plotting
from brushexp.results.plotting import COLORS, GREY, INK
from brushexp.results.tables import csv_table, markdown_table, over_seeds
from brushexp.system.files import write_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from pandas import DataFrame, Series

FRONTS = ("psnr", "perceptual")  # metrics that have a front
FLAGS = ["front_psnr", "front_perceptual"]
COLUMNS = ["picture", "number", "seconds", *FRONTS, "runs", *FLAGS, "overrides", "command"]
HEIGHT = 6.0  # inches: of the panels of an image
MOST_IMAGES = 6  # in a plot; the tables have all
SHORTEST = 0.01  # seconds: a logarithmic axis has no 0
MOST_LINES, LINE = 33, 46  # lines, and letters of a line, that tell what stands on the fronts
CROWDED = (0.04, 0.03)  # of width and height of a panel: points that are nearer to each other share a label
DIGITS = {"seconds": 2, "psnr": 2, "perceptual": 4}


def front(costs: Any) -> np.ndarray:
    """Which of some pairs of costs are on the Pareto front: no other is as low in both and lower in one."""
    costs = np.asarray(costs, float)
    as_low = (costs[:, None] <= costs[None]).all(-1)
    lower = (costs[:, None] < costs[None]).any(-1)
    return ~(as_low & lower).any(0)


def front_table(frame: DataFrame) -> DataFrame:
    """The settings of every image with at least two, in the order of seconds; numbers are means over seeds.

    Returns:
        ``picture``, ``number`` (in the order of seconds, from 1), ``seconds``, ``psnr``, ``perceptual``, ``runs``,
        ``front_psnr`` and ``front_perceptual`` (whether it is on them), ``overrides``, and ``command`` of a first run.
    """
    import pandas as pd  # noqa: PLC0415

    means = over_seeds(frame)
    table = means["mean"].reindex(columns=["seconds", *FRONTS]).join(means["run"]).dropna(subset=["seconds", "psnr"])
    table = table.rename_axis(["picture", "overrides"]).reset_index()
    found = []
    for _, settings in table.groupby("picture", sort=False):
        if len(settings) > 1:
            one = settings.sort_values("seconds", kind="stable")
            one["number"] = range(1, len(one) + 1)
            one["front_psnr"] = front(np.stack([one["seconds"], -one["psnr"]], 1))
            distance = one["perceptual"].fillna(math.inf)
            one["front_perceptual"] = front(np.stack([one["seconds"], distance], 1)) & (distance < math.inf)
            found.append(one)
    return (pd.concat(found) if found else table.iloc[:0]).reindex(columns=COLUMNS)


def write_front(folder: Path, frame: DataFrame) -> tuple[Path, Path, Path] | None:
    """Write ``pareto.md``, ``pareto.csv`` and ``pareto.png``; None if no two settings of an image were finished.

    Args:
        folder: where to.
        frame: the runs, see `brushexp.results.runs`.

    Returns:
        Their paths.
    """
    table = front_table(frame)
    if table.empty:
        return None
    lines = ["Seconds of optimisation, means over seeds. On a front: nothing else is as fast and as good."]
    for image, points in table.groupby("picture", sort=False):
        rows = points[["number", "seconds", *FRONTS, "runs"]].rename(columns={"number": ""})
        rows["front"] = [", ".join(np.compress(flags, FRONTS)) for flags in points[FLAGS].to_numpy(bool)]
        rows["overrides"] = points["overrides"]
        lines += ["", f"## {image}", "", markdown_table(rows, DIGITS), "", *_commands(points)]
    paths = folder / "pareto.md", folder / "pareto.csv", folder / "pareto.png"
    write_text(paths[0], "\n".join([*lines, ""]))
    write_text(paths[1], csv_table(table))
    plotting.save_figure(_plot(table, folder), paths[2])
    return paths


def _commands(points: DataFrame) -> list[str]:
    """What repeats those on a front; first what all of them begin with."""
    first = points[points[FLAGS].any(axis=1)]
    commands = {number: shlex.split(command) for number, command in zip(first["number"], first["command"], strict=True)}
    every = [word for word in next(iter(commands.values())) if all(word in words for words in commands.values())]
    rest = {number: [word for word in words if word not in every] for number, words in commands.items()}
    lines = [f"{number:>4}: {shlex.join(words) or '(no more)'}" for number, words in rest.items()]
    return ["Those on a front are repeated by", "", "```", shlex.join(every), *lines, "```"]


def _plot(table: DataFrame, folder: Path) -> Figure:
    """A row of two panels for each image, and beside it what stands on their fronts."""
    images = list(table.groupby("picture", sort=False))
    shown = images[:MOST_IMAGES]
    figure = plotting.new_figure(HEIGHT * len(shown))
    grid = figure.subplots(len(shown), 3, squeeze=False, width_ratios=(5, 5, 3))
    for panels, (image, points) in zip(grid, shown, strict=True):
        for axes, metric in zip(panels[:2], FRONTS, strict=True):
            _panel(axes, points, metric)
        panels[0].set_title(plotting.without_math(image), fontsize=11, loc="left", color=INK)
        first = points[points[FLAGS].any(axis=1)]
        lines = [f"{n:>2}  {text}" for n, text in zip(first["number"], first["overrides"], strict=True)]
        lines[MOST_LINES:] = ["more in pareto.md"] * (len(lines) > MOST_LINES)
        text = "\n".join(plotting.label_lines(line, LINE, most=1) for line in lines)
        panels[2].text(0, 1, text, va="top", fontsize=8.5, linespacing=1.3, color=INK, in_layout=False)
        panels[2].axis("off")
    more = f"; {len(images) - len(shown)} more in the table" * (len(images) > len(shown))
    plotting.entitle(figure, folder, f"what is worth its time; grey numbers are explained in pareto.md{more}")
    return figure


def _panel(axes: Axes, points: DataFrame, metric: str) -> None:
    """Numbered points and the front of one metric; far outliers are triangles at the edge."""
    plotting.tidy(axes)
    axes.set_xlabel("optimisation, s", fontsize=10)
    axes.set_ylabel(plotting.metric_label(metric), fontsize=10)
    points = points.dropna(subset=[metric])
    if points.empty:
        axes.text(0.5, 0.5, "not measured", transform=axes.transAxes, ha="center", color=GREY)
        return
    up = metric == "psnr"  # is better
    seconds, first = points["seconds"].clip(lower=SHORTEST), points[f"front_{metric}"]
    best = points[metric][first]
    span = 0.5 * (best.max() - best.min()) or max(abs(best.iloc[0]), 1e-9)
    values = points[metric].clip(*((best.min() - span, None) if up else (None, best.max() + span)))
    cut = values != points[metric]
    for chosen, marker, color, size in (
        (~first & ~cut, "o", GREY, 4), (~first & cut, "v" if up else "^", GREY, 5), (first, "o", COLORS[0], 6),
    ):  # fmt: skip
        axes.plot(seconds[chosen], values[chosen], marker, color=color, markersize=size, zorder=3)
    plotting.fit_scale(axes, "x", seconds)
    axes.margins(0.06)
    limits = axes.get_xlim()
    steps = [*seconds[first], limits[1]], [*values[first], values[first].iloc[-1]]
    axes.step(*steps, where="post", color=COLORS[0], linewidth=1.3, zorder=2)
    axes.set_xlim(limits)
    for chosen, look in (
        (first, {"fontsize": 9, "color": INK}),
        (~first, {"fontsize": 7, "color": "#707070"}),
    ):
        above = up == (chosen is first)  # the better side of a front is empty
        aside = {"ha": "right" if chosen is first else "left", "va": "bottom" if above else "top"}
        _write_numbers(axes, points["number"][chosen], seconds[chosen], values[chosen], aside | look)


def _write_numbers(axes: Axes, numbers: Series, xs: Series, ys: Series, look: dict[str, Any]) -> None:
    """Numbers beside points; those of points that are too near to each other stand at the first of them."""
    places = axes.transAxes.inverted().transform(axes.transData.transform(np.stack([xs, ys], 1))) / CROWDED
    written: list[tuple[np.ndarray, Any]] = []
    offset = (4 if look["ha"] == "left" else -4, 3 if look["va"] == "bottom" else -3)
    for number, point, place in zip(numbers, zip(xs, ys, strict=True), places, strict=True):
        near = next((text for other, text in written if (abs(place - other) < 1).all()), None)
        if near is None:
            text = axes.annotate(str(number), point, xytext=offset, textcoords="offset points", in_layout=False, **look)
            written.append((place, text))
        else:
            near.set_text(f"{near.get_text()},{number}")
