"""One plot of how runs got there: PSNR against wall time."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from brushexp.results.anytime import Curve, ahead, curve_of, mean_curve
from brushexp.results.plotting import COLORS, DASHES, FAINT, INK, fit_scale, new_figure, plain, save, tidy, wrapped
from brushexp.results.runs import by_settings
from brushexp.results.table import Result, collect, finished, summary

MOST = len(COLORS) * len(DASHES)  # curves that can be told apart


def write_curves(folder: Path, results: list[Result] | None = None) -> Path | None:
    """Write ``curves.png``: thin lines are runs, thick ones means over seeds; None if no two settings left curves.

    Of more settings than can be told apart, those are coloured that were ahead at some time.

    Args:
        folder: where to.
        results: of which runs; None means those of the sweep in this folder.
    """
    results = collect(folder) if results is None else results
    found = {}
    for setting in by_settings(folder, finished(results)):
        curves = [curve for run in setting.runs if (curve := curve_of(run)) is not None]
        if curves:
            found[setting.label] = curves
    if len(found) < 2:
        return None
    shown = list(found)
    if len(found) > MOST:
        shown = list(dict.fromkeys(name for _, name in ahead({n: mean_curve(c) for n, c in found.items()})))[-MOST:]
    title = f"{plain(folder.resolve().name)[:60]}: {summary(results)}"
    _draw(found, shown, title, folder / "curves.png")
    return folder / "curves.png"


def _draw(found: dict[str, list[Curve]], shown: list[str], title: str, path: Path) -> None:
    figure = new_figure()
    axes = figure.subplots()
    tidy(axes)
    for name in found.keys() - set(shown):
        axes.plot(*mean_curve(found[name]), linewidth=0.8, color=FAINT)
    for k, name in enumerate(shown):
        look: dict[str, Any] = {"color": COLORS[k % len(COLORS)], "linestyle": DASHES[k // len(COLORS)]}
        if len(found[name]) > 1:
            for curve in found[name]:
                axes.plot(*curve, linewidth=0.7, alpha=0.4, **look)
        axes.plot(*mean_curve(found[name]), linewidth=1.8, label=wrapped(name, 40), **look)
    fit_scale(axes, "x", [float(seconds[-1]) for curves in found.values() for seconds, _ in curves])
    axes.set_xlabel("wall time of the optimisation, s", fontsize=10)
    axes.set_ylabel("PSNR, dB", fontsize=10)
    axes.set_title(title, fontsize=11, loc="left", color=INK)
    heading = None if len(shown) == len(found) else "ahead at some time; the others are grey"
    axes.legend(
        title=heading, loc="upper left", bbox_to_anchor=(1.01, 1), fontsize=9, title_fontsize=9,
        frameon=False, ncols=1 + (len(shown) - 1) // 16,
    )  # fmt: skip
    save(figure, path)
