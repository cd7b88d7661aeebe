"""One plot of what the settings of a sweep do to the main metrics: the mean over seeds, and the spread."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from statistics import mean, stdev
from typing import TYPE_CHECKING, Any

from brushexp.results.plotting import (
    BAND,
    COLORS,
    MARKERS,
    NAMES,
    SIZE,
    as_number,
    fit_scale,
    is_wide,
    named,
    new_figure,
    plain,
    save,
    spaced,
    tidy,
    wrapped,
)
from brushexp.results.table import Result, collect, finished, groups, numbers, shortened, summary, varying

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# One panel each: the first of these metrics that some run has.
PANELS = (
    ("psnr", "psnr_alpha", "ssim"),
    ("perceptual", "lpips_alexnet", "lpips_squeeze", "lpips_vgg16", "fid_effl0", "fid_inception", "l2", "l1"),
    ("seconds",),
)
HIGHER_IS_BETTER = ("psnr", "psnr_alpha", "psnr_color", "ssim")
SERIES_HEIGHT, VALUE_HEIGHT, TALLEST = 0.13, 0.34, 30.0  # inches: of a dot, of a row with its label, of a figure
SPARSE = 0.5  # share of all combinations below which a sweep is a list
LABEL = 26  # letters in a line of a label
LETTER = 0.016  # width of a letter as a fraction of a panel


@dataclass(frozen=True)
class Effects:
    """What is drawn.

    Attributes:
        across: the setting along the axis.
        values: its values, as the command line had them; rising if they are numbers.
        others: the other settings that vary, without the seed.
        series: one for each combination of these, named by its values.
        found: metric -> (series, value) -> one number per seed.
    """

    across: str
    values: list[str]
    others: list[str]
    series: list[str]
    found: dict[str, dict[tuple[str, str], list[float]]]

    @property
    def places(self) -> list[float] | None:
        """The values as numbers; None if some are none."""
        places = [as_number(value) for value in self.values]
        return None if None in places else [place for place in places if place is not None]


def effects(results: list[Result]) -> Effects | None:
    """The finished runs by what varies beside the seed; None if there is nothing to compare.

    Nor if hardly any combination of values was run: a list of settings has its front, see `pareto`.
    """
    completed = finished(results)
    axes = {key: values for key, values in varying(completed).items() if key != "seed"}
    if not axes:
        return None
    across = max(axes, key=lambda key: len(axes[key]))
    others = [key for key in axes if key != across]
    grouped = groups(completed, [across, *others])
    words = {key: shortened(axes[key]) for key in others}
    names = {chosen: named(words, chosen[1:]) for chosen in grouped}
    metrics = [next((m for m in panel if numbers(completed, m)), None) for panel in PANELS]
    found = {
        metric: {(names[chosen], chosen[0]): n for chosen, runs in grouped.items() if (n := numbers(runs, metric))}
        for metric in metrics
        if metric is not None
    }
    most = max(map(len, found.values()), default=0)
    if most < 2 or most < SPARSE * len(set(names.values())) * len(axes[across]):
        return None
    values = axes[across]
    if all(as_number(value) is not None for value in values):
        values = sorted(values, key=float)
    return Effects(across, values, others, list(dict.fromkeys(names.values())), found)


def mean_and_spread(found: list[float]) -> tuple[float, float]:
    """Mean, and standard deviation (of a sample), which one number does not have: 0."""
    return mean(found), stdev(found) if len(found) > 1 else 0.0


def write_effect(folder: Path) -> Path | None:
    """Write ``effect.png`` of a sweep; None if nothing varies but the seed, or no two settings were finished.

    The setting with most values lies along an axis, across if it is a number; others are told apart by colour.
    """
    results = collect(folder)
    shown = effects(results)
    if shown is None:
        (folder / "effect.png").unlink(missing_ok=True)  # the first jobs of a list may have looked like a grid
        return None
    left_out = sum(result["status"] == "interrupted" for result in results)
    title = f"{plain(folder.resolve().name)[:60]}: {summary(results)}{f', {left_out} interrupted' * bool(left_out)}"
    if any(len(n) > 1 for cells in shown.found.values() for n in cells.values()):
        title += "; mean and standard deviation over seeds"
    save(_numeric(shown, title) if shown.places else _categorical(shown, title), folder / "effect.png")
    return folder / "effect.png"


def _numeric(shown: Effects, title: str) -> Figure:
    """Lines over the values of a setting."""
    figure = new_figure()
    places = dict(zip(shown.values, shown.places or [], strict=True))
    for axes, (metric, cells) in zip(_panels(figure, shown), shown.found.items(), strict=True):
        tidy(axes)
        for k, name in enumerate(shown.series):
            points = [(places[v], *mean_and_spread(cells[name, v])) for v in shown.values if (name, v) in cells]
            if points:
                xs, means, spreads = zip(*points, strict=True)
                axes.errorbar(xs, means, _bars(spreads), label=plain(name), linestyle="-", linewidth=1.5, **_look(k))
        _number_axis(axes, shown)
        axes.set_ylabel(_label(metric), fontsize=10)
        fit_scale(axes, "y", [number for n in cells.values() for number in n])
    _finish(figure, shown, title)
    return figure


def _number_axis(axes: Axes, shown: Effects) -> None:
    """The values of the setting as ticks, as far as they fit."""
    places = shown.places or []
    if is_wide(places):
        axes.set_xscale("log")
    axes.minorticks_off()
    scale = math.log if is_wide(places) else float
    low, high = scale(places[0]), scale(places[-1])
    fractions = [(scale(place) - low) / (high - low or 1) for place in places]
    names = [f"{place:g}" for place in places]
    kept = spaced(fractions, [LETTER * (len(name) + 1) for name in names])
    axes.set_xticks([places[k] for k in kept], [names[k] for k in kept])
    axes.set_xlabel(wrapped(shown.across, 50), fontsize=10)


def _categorical(shown: Effects, title: str) -> Figure:
    """A row for each value of a setting, with the runs as faint dots."""
    words = shortened(shown.values, 3 * LABEL)
    labels = [wrapped(words[value] or "not set", LABEL) for value in shown.values]
    lines = max(label.count("\n") for label in labels)
    row = max(VALUE_HEIGHT + 0.15 * lines, SERIES_HEIGHT * (len(shown.series) + 1))
    figure = new_figure(min(TALLEST, max(SIZE[1], 1.6 + row * len(labels))))
    grid = _panels(figure, shown, sharey=True)
    for axes, (metric, cells) in zip(grid, shown.found.items(), strict=True):
        tidy(axes)
        for k, name in enumerate(shown.series):
            shift = 0.7 * ((k + 0.5) / len(shown.series) - 0.5)
            points = [(y + shift, cells[name, v]) for y, v in enumerate(shown.values) if (name, v) in cells]
            if not points:
                continue
            ys, found = zip(*points, strict=True)
            means, spreads = zip(*map(mean_and_spread, found), strict=True)
            axes.errorbar(means, ys, xerr=_bars(spreads), label=plain(name), linestyle="none", **_look(k))
            dots = [(number, y) for y, n in points if len(n) > 1 for number in n]
            if dots:
                axes.scatter(
                    [number for number, _ in dots],
                    [y for _, y in dots],
                    s=14,
                    color=_look(k)["color"],
                    alpha=0.35,
                    linewidths=0,
                )
        axes.set_xlabel(_label(metric), fontsize=10)
        fit_scale(axes, "x", [number for n in cells.values() for number in n])
        for y in range(0, len(labels), 2):
            axes.axhspan(y - 0.5, y + 0.5, color=BAND, zorder=0)
    grid[0].set_yticks(range(len(labels)), labels)
    grid[0].set_ylim(len(labels) - 0.5, -0.5)
    grid[0].set_ylabel(wrapped(shown.across, 40), fontsize=10)
    _finish(figure, shown, title)
    return figure


def _panels(figure: Figure, shown: Effects, *, sharey: bool = False) -> list[Axes]:
    """Side by side, one for each metric."""
    return list(figure.subplots(1, len(shown.found), squeeze=False, sharey=sharey)[0])


def _finish(figure: Figure, shown: Effects, title: str) -> None:
    """Title, and a legend below where there are several series."""
    figure.suptitle(title, fontsize=11, x=0.01, ha="left")
    if len(shown.series) < 2:
        return
    drawn = {name: line for axes in figure.axes for line, name in zip(*axes.get_legend_handles_labels(), strict=True)}
    width = max(map(len, drawn))
    figure.legend(
        list(drawn.values()), list(drawn), loc="outside lower center", fontsize=9, frameon=False,
        ncols=max(1, min(len(drawn), 180 // (width + 6))), title=plain(", ".join(shown.others)), title_fontsize=9,
    )  # fmt: skip


def _look(k: int) -> dict[str, Any]:
    """Of series number ``k``."""
    color = COLORS[k % len(COLORS)]
    marker = MARKERS[(k + k // len(COLORS)) % len(MARKERS)]
    return {"color": color, "marker": marker, "markersize": 5.5, "capsize": 3, "elinewidth": 1.2}


def _bars(spreads: tuple[float, ...]) -> list[float] | None:
    """Error bars; a single run has none."""
    return [spread or math.nan for spread in spreads] if any(spreads) else None


def _label(metric: str) -> str:
    return f"{NAMES[metric]} ({'higher' if metric in HIGHER_IS_BETTER else 'lower'} is better)"
