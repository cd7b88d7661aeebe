"""One plot of how the runs of a sweep got there: PSNR against wall time."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import numpy as np

from brushexp.report.plotting import COLORS, DASHES, INK, fit_scale, named, new_figure, plain, save, tidy, wrapped
from brushexp.report.table import collect, groups, shortened, summary, varying

CURVES = Path("curves", "metrics.csv")  # in a run's folder, from logger=csv
POINTS = 300  # of a curve, at most
MOST = len(COLORS) * len(DASHES)  # curves that can be told apart

Curve = tuple[np.ndarray, np.ndarray]  # seconds, rising, and PSNR in dB


def write_curves(folder: Path) -> Path | None:
    """Write ``curves.png`` of a sweep: thin lines are runs, thick ones means over seeds.

    None if nothing varies but the seed, or no two settings have left curves, or too many to tell them apart.
    """
    results = [result for result in collect(folder) if (folder / result["run"] / CURVES).is_file()]
    axes = {key: values for key, values in varying(results).items() if key != "seed"}
    found = {}
    for chosen, runs in groups(results, list(axes)).items():
        curves = [curve for run in runs if (curve := read_curve(folder / run["run"] / CURVES)) is not None]
        if curves:
            found[chosen] = curves
    if not axes or not 2 <= len(found) <= MOST:
        return None
    words = {key: shortened(values) for key, values in axes.items()}
    names = {chosen: named(words, chosen) for chosen in found}
    title = f"{plain(folder.resolve().name)[:60]}: {summary(collect(folder))}"
    _draw({names[chosen]: curves for chosen, curves in found.items()}, title, ", ".join(axes), folder / "curves.png")
    return folder / "curves.png"


def read_curve(path: Path) -> Curve | None:
    """Seconds and PSNR of a run, from the file that logger=csv writes; None if it has no two of them."""
    try:
        with path.open(newline="", encoding="utf-8") as file:
            rows = csv.reader(file)
            head = next(rows, [])
            if not {"seconds", "psnr"} <= set(head):
                return None
            columns = head.index("seconds"), head.index("psnr")
            points = [(row[columns[0]], row[columns[1]]) for row in rows if len(row) == len(head)]
        numbers = np.array([point for point in points[:: 1 + len(points) // POINTS] if all(point)], float)
    except (OSError, ValueError):
        return None
    numbers = numbers.reshape(-1, 2)
    numbers = numbers[np.isfinite(numbers).all(1)]
    numbers = numbers[numbers[:, 0].argsort(kind="stable")]
    return (numbers[:, 0], numbers[:, 1]) if len(numbers) > 1 else None


def mean_curve(curves: list[Curve]) -> Curve:
    """The mean PSNR of several runs at the times that all of them have seen, between their points as on lines."""
    first, last = max(seconds[0] for seconds, _ in curves), min(seconds[-1] for seconds, _ in curves)
    times = np.unique(np.concatenate([seconds for seconds, _ in curves]))
    times = times[(times >= first) & (times <= last)]
    return times, np.mean([np.interp(times, *curve) for curve in curves], axis=0)


def _draw(found: dict[str, list[Curve]], title: str, settings: str, path: Path) -> None:
    figure = new_figure()
    axes = figure.subplots()
    tidy(axes)
    for k, (name, curves) in enumerate(found.items()):
        look: dict[str, Any] = {"color": COLORS[k % len(COLORS)], "linestyle": DASHES[k // len(COLORS)]}
        if len(curves) > 1:
            for curve in curves:
                axes.plot(*curve, linewidth=0.7, alpha=0.4, **look)
        axes.plot(*mean_curve(curves), linewidth=1.8, label=wrapped(name, 40), **look)
    fit_scale(axes, "x", [float(seconds[-1]) for curves in found.values() for seconds, _ in curves])
    axes.set_xlabel("wall time of the optimisation, s", fontsize=10)
    axes.set_ylabel("PSNR, dB", fontsize=10)
    axes.set_title(title, fontsize=11, loc="left", color=INK)
    axes.legend(
        title=plain(settings), loc="upper left", bbox_to_anchor=(1.01, 1), fontsize=9, title_fontsize=9,
        frameon=False, ncols=1 + (len(found) - 1) // 16,
    )  # fmt: skip
    save(figure, path)
