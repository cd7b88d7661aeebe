"""Plot a sweep's main metrics against its settings, with means and standard deviations over seeds."""

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from brushexp.contracts.results import differences, over_seeds, quantities, run_count, shorten, varying_settings
from brushexp_studies import plotting
from brushexp_studies.plotting import COLORS, FIGURE_SIZE, LABEL, MARKERS, TALLEST

# Each panel shows the first of these metrics that any run has.
PANELS = (
    ("psnr", "psnr_alpha", "ssim"),
    ("perceptual", "lpips_alexnet", "lpips_squeeze", "lpips_vgg16", "fid_effl0", "fid_inception", "l2", "l1"),
    ("seconds",),
)
POINT_HEIGHT, ROW_HEIGHT = 0.13, 0.6  # height of a point and minimum height of a row, in inches
SPARSE = 0.5  # share of all combinations below which a sweep counts as a list


def effects(frame: pd.DataFrame) -> dict[str, pd.DataFrame] | None:
    """Tabulate the main metrics against the setting with the most values, for each combination of the other settings.

    The metrics are averaged over seeds. Each table has one row per value, in ascending order if all values are numbers,
    and the columns ("mean", metric) and ("std", metric). Returns None if there is nothing to compare, or if only a few
    of the possible combinations were run; in the latter case, `pareto` compares the settings.
    """
    axes = {k: values for k, values in varying_settings(frame[frame["run", "label"].notna()]).items() if k != "seed"}
    if not axes:
        return None
    across = max(axes, key=lambda key: len(axes[key]))
    means = over_seeds(frame)
    table = means[["mean", "std"]].set_index(means["setting", across].fillna("").rename(across))
    measured = list(table["mean"].dropna(axis=1, how="all"))
    metrics = [key for panel in PANELS for key in [key for key in panel if key in measured][:1]]
    table = table[[(part, metric) for part in ("mean", "std") for metric in metrics]]
    others = means["setting"][[key for key in axes if key != across]]
    typed = [{key: value for key, value in one.items() if isinstance(value, str)} for _, one in others.iterrows()]
    names = [" ".join(parts) or "default" for parts in differences(typed)]
    most = table["mean"].notna().sum().max() if metrics else 0
    if most < 2 or most < SPARSE * len(set(names)) * len(axes[across]):
        return None
    values = pd.to_numeric(pd.Series(axes[across]), errors="coerce")
    if numeric := bool(np.isfinite(values).all()):
        table.index = table.index.astype(float)
    series = {name: one.groupby(level=0).mean() for name, one in table.groupby(names, sort=False)}
    return series if numeric else {name: one.reindex(axes[across]) for name, one in series.items()}


def write_effect(folder: Path, frame: pd.DataFrame) -> Path | None:
    """Write ``effect.png`` for a sweep.

    The setting with the most values has its own axis, which is horizontal if the values are numbers; the other
    settings are distinguished by colour. Returns None if only the seed varies, or if fewer than two settings finished.
    """
    series = effects(frame)
    if series is None:
        (folder / "effect.png").unlink(missing_ok=True)  # the first jobs of a list may have looked like a grid
        return None
    first = next(iter(series.values()))
    numeric, metrics = first.index.dtype == float, list(first["mean"])
    table = pd.concat(series, axis=1, sort=numeric)
    row = max(ROW_HEIGHT, POINT_HEIGHT * (len(series) + 1))
    height = FIGURE_SIZE[1] if numeric else min(TALLEST, max(FIGURE_SIZE[1], 1.6 + row * len(table)))
    figure = plotting.new_figure(height)
    panels = figure.subplots(1, len(metrics), squeeze=False, sharey=not numeric)[0]
    for axes, metric in zip(panels, metrics, strict=True):
        mean, spread = (table.xs((part, metric), axis=1, level=(1, 2)) for part in ("mean", "std"))
        _draw(axes, mean, spread, metric)
    if not numeric:
        panels[0].set_ylabel(plotting.label_lines(table.index.name, 40))
    has_spread = bool(table.xs("std", axis=1, level=1).notna().any(axis=None))
    plotting.add_title(figure, folder, run_count(frame) + "; mean and standard deviation over seeds" * has_spread)
    if len(series) > 1:
        columns = max(1, min(len(series), 180 // (max(map(len, series)) + 6)))
        handles = panels[0].get_legend_handles_labels()
        figure.legend(*handles, loc="outside lower center", fontsize=9, frameon=False, ncols=columns)
    return plotting.save_figure(figure, folder / "effect.png")


def _draw(axes: Axes, mean: pd.DataFrame, spread: pd.DataFrame, metric: str) -> None:
    """Plot each column as one series: a line if the values are numbers, or otherwise a strip of points per value."""
    plotting.tidy(axes)
    looks, label = [_look(k, name) for k, name in enumerate(mean)], quantities()[metric].label
    if mean.index.dtype == float:
        for name, look in zip(mean, looks, strict=True):
            values = mean[name].dropna()
            axes.errorbar(values.index, values, yerr=spread[name][values.index], linewidth=1.5, **look)
        plotting.fit_scale(axes, "x", mean.index)
        axes.set(xlabel=plotting.label_lines(mean.index.name, 50), ylabel=label)
    else:
        words = [word or "not set" for word in shorten(list(mean.index), 2 * LABEL).values()]
        plotting.draw_strips(axes, mean.set_axis(words), looks, spread)
        axes.set_xlabel(label)
    plotting.fit_scale(axes, "y" if mean.index.dtype == float else "x", mean.to_numpy().ravel())


def _look(k: int, name: str) -> dict[str, Any]:
    return {
        "label": plotting.without_math(name), "color": COLORS[k % len(COLORS)], "markersize": 5.5, "capsize": 3,
        "elinewidth": 1.2, "marker": MARKERS[(k + k // len(COLORS)) % len(MARKERS)],
    }  # fmt: skip
