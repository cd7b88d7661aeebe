"""One plot of what the settings of a sweep do to the main metrics: means over seeds, and the spread."""

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from brushexp.reporting import plotting
from brushexp.reporting.plotting import COLORS, MARKERS, SIZE
from brushexp.results.quantities import quantities
from brushexp.results.runs import differences, shortened
from brushexp.results.tables import over_seeds, run_count, varying

# One panel each: the first of these metrics that some run has.
PANELS = (
    ("psnr", "psnr_alpha", "ssim"),
    ("perceptual", "lpips_alexnet", "lpips_squeeze", "lpips_vgg16", "fid_effl0", "fid_inception", "l2", "l1"),
    ("seconds",),
)
SERIES_HEIGHT, VALUE_HEIGHT, TALLEST = 0.13, 0.6, 30.0  # inches: of a dot, of a row with its label, of a figure
SPARSE = 0.5  # share of all combinations below which a sweep is a list
LABEL = 26  # letters in a line of a label


def effects(frame: pd.DataFrame) -> dict[str, pd.DataFrame] | None:
    """The main metrics by the setting with most values, a data frame for each combination of the others but the seed.

    It has a row per value, rising if all are numbers, and columns ("mean", metric) and ("std", metric). None if there
    is nothing to compare, or if hardly any combination was run: a list of settings has its front, see `pareto`.
    """
    axes = {k: values for k, values in varying(frame[frame["run", "label"].notna()]).items() if k != "seed"}
    if not axes:
        return None
    across = max(axes, key=lambda key: len(axes[key]))
    means = over_seeds(frame)
    found = means[["mean", "std"]].set_index(means["setting", across].fillna("").rename(across))
    known = list(found["mean"].dropna(axis=1, how="all"))
    metrics = [key for panel in PANELS for key in [key for key in panel if key in known][:1]]
    found = found[[(part, metric) for part in ("mean", "std") for metric in metrics]]
    others = means["setting"][[key for key in axes if key != across]]
    typed = [{key: value for key, value in one.items() if isinstance(value, str)} for one in others.to_dict("records")]
    names = [" ".join(parts) or "default" for parts in differences(typed)]
    most = found["mean"].notna().sum().max() if metrics else 0
    if most < 2 or most < SPARSE * len(set(names)) * len(axes[across]):
        return None
    values = pd.to_numeric(pd.Series(axes[across]), errors="coerce")
    if numeric := bool(np.isfinite(values).all()):
        found.index = found.index.astype(float)
    series = {name: one.groupby(level=0).mean() for name, one in found.groupby(names, sort=False)}
    return series if numeric else {name: one.reindex(axes[across]) for name, one in series.items()}


def write_effect(folder: Path, frame: pd.DataFrame) -> Path | None:
    """Write ``effect.png`` of a sweep; None if nothing varies but the seed, or no two settings were finished.

    The setting with most values lies along an axis, across if it is a number; others are told apart by colour.
    """
    series = effects(frame)
    if series is None:
        (folder / "effect.png").unlink(missing_ok=True)  # the first jobs of a list may have looked like a grid
        return None
    first = next(iter(series.values()))
    numeric, metrics = first.index.dtype == float, list(first["mean"])
    row = max(VALUE_HEIGHT, SERIES_HEIGHT * (len(series) + 1))
    figure = plotting.new_figure(SIZE[1] if numeric else min(TALLEST, max(SIZE[1], 1.6 + row * len(first))))
    panels = figure.subplots(1, len(metrics), squeeze=False, sharey=not numeric)[0]
    for axes, metric in zip(panels, metrics, strict=True):
        plotting.tidy(axes)
        (_over_numbers if numeric else _in_rows)(axes, series, metric)
    panels[0].set_ylabel(panels[0].get_ylabel() or plotting.label_lines(first.index.name, 40), fontsize=10)
    spread = any(one["std"].notna().any(axis=None) for one in series.values())
    plotting.entitle(figure, folder, run_count(frame) + "; mean and standard deviation over seeds" * spread)
    if len(series) > 1:
        columns = max(1, min(len(series), 180 // (max(map(len, series)) + 6)))
        handles = panels[0].get_legend_handles_labels()
        figure.legend(*handles, loc="outside lower center", fontsize=9, frameon=False, ncols=columns)
    return plotting.save_figure(figure, folder / "effect.png")


def _over_numbers(axes: Axes, series: dict[str, pd.DataFrame], metric: str) -> None:
    for k, (name, one) in enumerate(series.items()):
        known = one.dropna(subset=[("mean", metric)])
        axes.errorbar(known.index, known["mean"][metric], yerr=known["std"][metric], **_look(k, name))
    plotting.fit_scale(axes, "x", [value for one in series.values() for value in one.index])
    plotting.fit_scale(axes, "y", [value for one in series.values() for value in one["mean"][metric]])
    axes.set_xlabel(plotting.label_lines(next(iter(series.values())).index.name, 50), fontsize=10)
    axes.set_ylabel(quantities()[metric].label, fontsize=10)


def _in_rows(axes: Axes, series: dict[str, pd.DataFrame], metric: str) -> None:
    """A row for each word, in which the series lie above each other."""
    for k, (name, one) in enumerate(series.items()):
        places = np.arange(len(one)) + 0.7 * ((k + 0.5) / len(series) - 0.5)
        axes.errorbar(one["mean"][metric], places, xerr=one["std"][metric], **_look(k, name) | {"linestyle": "none"})
    plotting.fit_scale(axes, "x", [value for one in series.values() for value in one["mean"][metric]])
    axes.set_xlabel(quantities()[metric].label, fontsize=10)
    words = [word or "not set" for word in shortened(list(one.index), 2 * LABEL).values()]
    axes.set_yticks(range(len(words)), [plotting.label_lines(word, LABEL) for word in words])
    axes.set_ylim(len(words) - 0.5, -0.5)


def _look(k: int, name: str) -> dict[str, Any]:
    return {
        "label": plotting.without_math(name), "color": COLORS[k % len(COLORS)], "markersize": 5.5, "capsize": 3,
        "elinewidth": 1.2, "linewidth": 1.5, "marker": MARKERS[(k + k // len(COLORS)) % len(MARKERS)],
    }  # fmt: skip
