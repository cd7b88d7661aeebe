"""Find the settings that are worth their cost: those on the Pareto fronts of quality metrics against cost."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from brushexp.contracts import UserError
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

COSTS = ("cpu_seconds", "seconds", "strokes_per_second")  # the cost is the first of these that every run has
FRONTS = ("psnr", "perceptual")  # metrics that have a front; without the first, the first of OTHERS replaces it
OTHERS = ("fid_effl0", "fid_inception", "psnr_alpha", "l2")  # metrics of networks
EVERY_RUN = "all runs"  # heading for runs that paint no picture
OWN_FEATURES = {"perceptual": ("perceptual", "lpips", "style")}  # losses that optimise the features of a metric
HEIGHT = 6.0  # height in inches of the panels of an image
MOST_IMAGES = 6  # maximum number of images in the plot; the tables have all
SHORTEST_SECONDS = 0.01  # lower bound on a logarithmic axis
MOST_LINES, LINE = 20, 42  # maximum number of settings listed beside the panels, and letters per line


@dataclass(frozen=True)
class Trade:
    """The names of a cost and of the metrics traded against it; each metric has its own front."""

    cost: str
    metrics: tuple[str, ...]

    @property
    def columns(self) -> list[str]:
        """The columns of a table of fronts."""
        return ["picture", "number", self.cost, *self.metrics, "runs", *self.flags, "overrides", "command"]

    @property
    def flags(self) -> list[str]:
        """The columns that mark, for each metric, the settings on its front."""
        return [f"front_{metric}" for metric in self.metrics]


def trade_of(frame: pd.DataFrame, cost: str | None = None, metrics: Sequence[str] = ()) -> Trade | None:
    """Choose a cost and metrics that the finished runs have recorded, unless the caller names them.

    Returns None if the runs have no cost or no metric. Raises UserError if no run has a given cost or metric.
    """
    known = [key for key, values in frame["metric"].items() if pd.to_numeric(values, errors="coerce").notna().any()]
    for key in filter(None, (cost, *metrics)):
        if key not in known:
            raise UserError(f"no run has {key}; choose from {', '.join(key for key in quantities() if key in known)}")
    chosen = tuple(metrics) or tuple(key for key in FRONTS if key in known and FRONTS[0] in known)
    chosen = chosen or tuple(key for key in OTHERS if key in known)[:1]
    if not chosen:
        return None
    judged = frame["metric"][frame["metric"][chosen[0]].notna()]
    costs = [key for key in COSTS if key in known and judged[key].notna().all()]
    cost = cost or next(iter(costs or [key for key in COSTS if key in known]), None)
    return None if cost is None else Trade(cost, chosen)


def front(costs: Any) -> np.ndarray:
    """Check which pairs of costs are on the Pareto front, that is, are not dominated by any other pair."""
    costs = np.asarray(costs, float)
    as_low = (costs[:, None] <= costs[None]).all(-1)
    lower = (costs[:, None] < costs[None]).any(-1)
    return ~(as_low & lower).any(0)


def front_table(frame: pd.DataFrame, trade: Trade) -> pd.DataFrame:
    """Tabulate the settings in order of cost, for every image with at least two settings.

    Values are means over seeds.
    """
    named = frame.copy()
    named["run", "image"] = named["run", "image"].fillna("").replace("", EVERY_RUN)
    means = over_seeds(named)
    values = means["mean"].reindex(columns=[trade.cost, *trade.metrics])
    table = values.join(means["run"]).dropna(subset=[trade.cost, trade.metrics[0]])
    table = table.rename_axis(["picture", "overrides"]).reset_index()
    parts = []
    for _, settings in table.groupby("picture", sort=False):
        if len(settings) > 1:
            lower_first = _cost_of(settings[trade.cost], trade.cost, as_cost=True).argsort(kind="stable")
            one = settings.iloc[lower_first]
            one = one.assign(number=range(1, len(one) + 1))
            for metric, flag in zip(trade.metrics, trade.flags, strict=True):
                loss = _cost_of(one[metric], metric)
                pairs = np.stack([_cost_of(one[trade.cost], trade.cost, as_cost=True), loss], axis=1)
                one[flag] = front(pairs) & (loss < math.inf)
            parts.append(one)
    return (pd.concat(parts) if parts else table.iloc[:0]).reindex(columns=trade.columns)


def _cost_of(values: pd.Series, key: str, *, as_cost: bool = False) -> np.ndarray:
    """Negate values if higher is better, so that lower is always better; missing values become infinite."""
    better = quantities()[key].better or ("lower" if as_cost else "higher")
    return (values if better == "lower" else -values).astype(float).fillna(math.inf).to_numpy()


def write_front(folder: Path, frame: pd.DataFrame, cost: str | None = None, metrics: Sequence[str] = ()) -> Path | None:
    """Write ``pareto.md``, ``.csv`` and ``.png``, and return the path of the first.

    Returns None if no image has two settings.
    """
    trade = trade_of(frame, cost, metrics)
    table = pd.DataFrame() if trade is None else front_table(frame, trade)
    if trade is None or table.empty:
        return None
    lines = [f"Cost: {_label(trade.cost)}, means over seeds. On a front, nothing else costs as little and is as good."]
    for remark in filter(None, (remark_on_own_features(frame, trade.metrics), remark_on_provenance(frame))):
        lines += ["", escape_markdown(remark)]
    digits = {key: quantities()[key].digits for key in (trade.cost, *trade.metrics)}
    digits |= dict.fromkeys(("cpu_seconds", "seconds"), 2)
    for image, points in table.groupby("picture", sort=False):
        rows = points[["number", trade.cost, *trade.metrics, "runs"]].rename(columns={"number": ""})
        rows["front"] = [", ".join(np.compress(flags, trade.metrics)) for flags in points[trade.flags].to_numpy(bool)]
        rows["overrides"] = points["overrides"]
        commands = [f"{number:>4}: {text}" for number, text in _on_a_front(points, trade, "command")]
        lines += ["", f"## {image}", "", markdown_table(rows, digits), ""]
        lines += ["Commands for the settings on a front:", "", "```", *commands, "```"]
    write_text(folder / "pareto.md", "\n".join([*lines, ""]))
    write_text(folder / "pareto.csv", csv_table(table))
    plotting.save_figure(_plot(table, trade, folder), folder / "pareto.png")
    return folder / "pareto.md"


def remark_on_own_features(frame: pd.DataFrame, metrics: Sequence[str]) -> str:
    """Warn about settings that directly minimise the features of a metric; return "" if there are none."""
    remarks = []
    for metric in metrics:
        losses = OWN_FEATURES.get(metric, ())
        typed = [str(value) for words in frame["run", "overrides"] for key, value in words.items() if key == "loss"]
        if own := [loss for loss in losses if any(loss in value for value in typed)]:
            name = quantities()[metric].name
            remarks.append(
                f"Settings with {' or '.join(f'loss={loss}' for loss in own)} minimise the features of {name}."
            )
    return " ".join(remarks)


def _on_a_front(points: pd.DataFrame, trade: Trade, column: str) -> list[tuple[int, str]]:
    """List the number, and the value in ``column``, of each setting that is on any front."""
    return list(points.loc[points[trade.flags].any(axis=1), ["number", column]].itertuples(index=False, name=None))


def _plot(table: pd.DataFrame, trade: Trade, folder: Path) -> Figure:
    """Draw a row of panels for each image, one per metric, with a list of the settings on the fronts beside them."""
    images = list(table.groupby("picture", sort=False))[:MOST_IMAGES]
    figure = plotting.new_figure(HEIGHT * len(images))
    n = len(trade.metrics)
    grid = figure.subplots(len(images), n + 1, squeeze=False, width_ratios=(*n * (5,), 3))
    for panels, (image, points) in zip(grid, images, strict=True):
        for axes, metric in zip(panels[:-1], trade.metrics, strict=True):
            _panel(axes, points, trade.cost, metric)
        panels[0].set_title(plotting.without_math(image), fontsize=11, loc="left", color=INK)
        lines = [f"{number:>2}  {text}" for number, text in _on_a_front(points, trade, "overrides")]
        lines[MOST_LINES:] = ["more in pareto.md"] * (len(lines) > MOST_LINES)
        text = "\n".join(plotting.label_lines(line, LINE, most=2) for line in lines)
        panels[-1].text(0, 1, text, va="top", fontsize=8.5, linespacing=1.3, color=INK, in_layout=False)
        panels[-1].axis("off")
    plotting.add_title(figure, folder, "settings worth their cost; pareto.md has all settings")
    return figure


def _label(key: str) -> str:
    """Return the axis label of a quantity; its direction is stated only if it is known."""
    return quantities()[key].label if quantities()[key].better else quantities()[key].name


def _panel(axes: Axes, points: pd.DataFrame, cost: str, metric: str) -> None:
    """Plot a metric of all settings against cost, number those on the front, and fit the vertical axis to the front."""
    plotting.tidy(axes)
    axes.set(xlabel=_label(cost), ylabel=_label(metric))
    points = points.dropna(subset=[metric])
    if points.empty:
        axes.text(0.5, 0.5, "not measured", transform=axes.transAxes, ha="center", color=GREY)
        return
    costs, values, first = points[cost].clip(lower=SHORTEST_SECONDS), points[metric], points[f"front_{metric}"]
    best = values[first]
    axes.plot(costs[~first], values[~first], "o", color=GREY, markersize=4)
    axes.step(
        [*costs[first], costs.iloc[-1]], [*best, best.iloc[-1]], where="post", color=COLORS[0],
        marker="o", markevery=list(range(len(best))),
    )  # fmt: skip
    plotting.fit_scale(axes, "x", costs)
    is_higher = (quantities()[metric].better or "higher") == "higher"
    below, above = (1.0, 0.1) if is_higher else (0.1, 1.0)  # more room where settings are worse
    if (span := np.ptp(best)) > 0:
        axes.set_ylim(best.min() - below * span, best.max() + above * span)
    aside: Any = {"xytext": (-4, 3 if is_higher else -11), "textcoords": "offset points", "ha": "right"}
    for number, x, y in zip(points["number"][first], costs[first], best, strict=True):
        axes.annotate(str(number), (x, y), fontsize=9, color=INK, **aside)
