"""One plot of what the settings of a sweep do to the main metrics: means over seeds, and the spread."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from brushexp.results import plotting
from brushexp.results.plotting import BAND, COLORS, MARKERS, SIZE
from brushexp.results.runs import differences, shortened
from brushexp.results.tables import over_seeds, run_count, varying

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from pandas import DataFrame

# One panel each: the first of these metrics that some run has.
PANELS = (
    ("psnr", "psnr_alpha", "ssim"),
    ("perceptual", "lpips_alexnet", "lpips_squeeze", "lpips_vgg16", "fid_effl0", "fid_inception", "l2", "l1"),
    ("seconds",),
)
SERIES_HEIGHT, VALUE_HEIGHT, TALLEST = 0.13, 0.34, 30.0  # inches: of a dot, of a row with its label, of a figure
SPARSE = 0.5  # share of all combinations below which a sweep is a list
LABEL = 26  # letters in a line of a label


@dataclass(frozen=True)
class Effects:
    """What is drawn.

    Attributes:
        across: the setting along the axis: that with most values.
        values: its values as the command line had them; rising if all are numbers.
        places: these numbers, or, of words, 0, 1, 2 and so on.
        numeric: whether they are numbers.
        series: a data frame for each combination of the other settings, by its name: a row per value, with columns
            ("mean", metric) and ("std", metric).
    """

    across: str
    values: list[str]
    places: list[float]
    numeric: bool
    series: dict[str, DataFrame]


def effects(frame: DataFrame) -> Effects | None:
    """The main metrics by what varies beside the seed; None if there is nothing to compare.

    Nor if hardly any combination of values was run: a list of settings has its front, see `brushexp.results.pareto`.
    """
    import pandas as pd  # noqa: PLC0415

    axes = {k: values for k, values in varying(frame[frame["run", "label"].notna()]).items() if k != "seed"}
    if not axes:
        return None
    across = max(axes, key=lambda key: len(axes[key]))
    means = over_seeds(frame)
    found = means[["mean", "std"]].set_index(means["setting", across].fillna("").to_numpy())
    metrics = [
        next((m for m in panel if m in found["mean"] and found["mean"][m].notna().any()), None) for panel in PANELS
    ]
    found = found[[(part, metric) for part in ("mean", "std") for metric in metrics if metric]]
    others = means["setting"][[key for key in axes if key != across]]
    typed = [{key: value for key, value in one.items() if isinstance(value, str)} for one in others.to_dict("records")]
    names = [" ".join(parts) or "default" for parts in differences(typed)]
    most = found["mean"].notna().sum().max() if len(found.columns) else 0
    if most < 2 or most < SPARSE * len(set(names)) * len(axes[across]):
        return None
    places = np.asarray(pd.to_numeric(axes[across], errors="coerce"), float)
    numeric = bool(np.isfinite(places).all())
    places = places if numeric else np.arange(len(places), dtype=float)
    values = [axes[across][k] for k in places.argsort(kind="stable")]
    series = {name: one for name, one in found.groupby(names, sort=False)}
    return Effects(across, values, sorted(places.tolist()), numeric, series)


def write_effect(folder: Path, frame: DataFrame) -> Path | None:
    """Write ``effect.png`` of a sweep; None if nothing varies but the seed, or no two settings were finished.

    The setting with most values lies along an axis, across if it is a number; others are told apart by colour.

    Args:
        folder: where to.
        frame: the runs, see `brushexp.results.runs`.
    """
    shown = effects(frame)
    if shown is None:
        (folder / "effect.png").unlink(missing_ok=True)  # the first jobs of a list may have looked like a grid
        return None
    metrics = list(next(iter(shown.series.values()))["mean"])
    labels = [plotting.label_lines(v or "not set", LABEL) for v in shortened(shown.values, 3 * LABEL).values()]
    row = max(VALUE_HEIGHT + 0.15 * max(label.count("\n") for label in labels), SERIES_HEIGHT * (len(shown.series) + 1))
    figure = plotting.new_figure(SIZE[1] if shown.numeric else min(TALLEST, max(SIZE[1], 1.6 + row * len(labels))))
    panels = figure.subplots(1, len(metrics), squeeze=False, sharey=not shown.numeric)[0]
    for axes, metric in zip(panels, metrics, strict=True):
        plotting.tidy(axes)
        _draw_series(axes, shown, metric)
        values = [value for one in shown.series.values() for value in one["mean"][metric]]
        plotting.fit_scale(axes, "y" if shown.numeric else "x", values)
        (axes.set_ylabel if shown.numeric else axes.set_xlabel)(plotting.metric_label(metric), fontsize=10)
        if shown.numeric:
            plotting.fit_scale(axes, "x", shown.places)
            axes.set_xlabel(plotting.label_lines(shown.across, 50), fontsize=10)
    if not shown.numeric:
        panels[0].set_yticks(range(len(labels)), labels)
        panels[0].set_ylim(len(labels) - 0.5, -0.5)
        panels[0].set_ylabel(plotting.label_lines(shown.across, 40), fontsize=10)
    _entitle(figure, folder, frame, shown)
    return plotting.save_figure(figure, folder / "effect.png")


def _draw_series(axes: Axes, shown: Effects, metric: str) -> None:
    """Lines over numbers; over words a row for each, in which the series lie above each other."""
    places = dict(zip(shown.values, shown.places, strict=True))
    for k, (name, found) in enumerate(shown.series.items()):
        one = found.dropna(subset=[("mean", metric)])
        one = one.loc[[value for value in shown.values if value in one.index]]
        means, spreads = one["mean"][metric], one["std"][metric].where(one["std"][metric] > 0)
        at = [places[value] for value in one.index]
        look: dict[str, Any] = {
            "label": plotting.without_math(name), "color": COLORS[k % len(COLORS)], "markersize": 5.5, "capsize": 3,
            "elinewidth": 1.2, "linewidth": 1.5, "marker": MARKERS[(k + k // len(COLORS)) % len(MARKERS)],
        }  # fmt: skip
        if shown.numeric:
            axes.errorbar(at, means, yerr=spreads, **look)
        else:
            shift = 0.7 * ((k + 0.5) / len(shown.series) - 0.5)
            axes.errorbar(means, [place + shift for place in at], xerr=spreads, linestyle="none", **look)
    for y in range(0, 0 if shown.numeric else len(shown.values), 2):
        axes.axhspan(y - 0.5, y + 0.5, color=BAND, zorder=0)


def _entitle(figure: Figure, folder: Path, frame: DataFrame, shown: Effects) -> None:
    """Title, and a legend below where there are several series."""
    interrupted = (frame["run", "status"] == "interrupted").sum()
    title = run_count(frame) + f", {interrupted} interrupted" * bool(interrupted)
    if any(one["std"].notna().any(axis=None) for one in shown.series.values()):
        title += "; mean and standard deviation over seeds"
    plotting.entitle(figure, folder, title)
    if len(shown.series) > 1:
        handles, names = figure.axes[0].get_legend_handles_labels()
        columns = max(1, min(len(names), 180 // (max(map(len, names)) + 6)))
        figure.legend(handles, names, loc="outside lower center", fontsize=9, frameon=False, ncols=columns)
