"""Compare settings by the quality they reach in equal time, and by the time they need for equal quality."""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from pandas import DataFrame

from brushexp.contracts.files import write_text
from brushexp.contracts.results import (
    LEAD,
    Curve,
    curves_by_image,
    escape_markdown,
    leaders,
    markdown_table,
    mean_curve,
    mean_curves,
    remark_on_provenance,
    run_count,
)
from brushexp_studies import plotting
from brushexp_studies.plotting import COLORS, DASHES, FAINT, FIGURE_SIZE, INK

TIMES = (0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 60, 120, 300, 600, 1800)  # seconds
LEVELS = (15, 20, 25, 28, 30, 33, 36, 40, 45)  # dB
MOST_CURVES = len(COLORS) * len(DASHES)  # number of distinguishable curves
MOST_IMAGES = 6  # maximum number of images in a plot


def quality_at(curve: Curve, seconds: float, *, after_end: bool = False) -> float | None:
    """Interpolate the best PSNR, in dB, reached within ``seconds``.

    Returns None before the first point of the curve and, unless ``after_end`` is set, after its last point.
    """
    times, psnr = curve
    if not times[0] <= seconds <= (math.inf if after_end else times[-1]):
        return None
    return float(np.interp(seconds, times, np.maximum.accumulate(psnr)))


def time_to(curve: Curve, psnr: float) -> float | None:
    """Interpolate the time, in seconds, at which a PSNR in dB was first reached.

    The result is never earlier than the curve's first point. Returns None if the PSNR was never reached.
    """
    times, best = curve[0], np.maximum.accumulate(curve[1])
    k = int(np.searchsorted(best, psnr))
    around = slice(max(k - 1, 0), k + 1)
    return None if k == len(best) else float(np.interp(psnr, best[around], times[around]))


def write_anytime(folder: Path, frame: DataFrame) -> Path | None:
    """Write ``anytime.md``, which tabulates quality at equal time and time to equal quality.

    Returns None if there are fewer than two curves.
    """
    lines = ["Seconds of optimisation; a run keeps its best picture so far. Means over seeds."]
    for image, curves in curves_by_image(frame).items():
        if len(means := mean_curves(curves)) > 1:
            lines += ["", f"## {image}", "", *_comparison(means)]
    if len(lines) == 1:
        return None
    if remark := remark_on_provenance(frame):
        lines[1:1] = ["", escape_markdown(remark)]
    write_text(folder / "anytime.md", "\n".join([*lines, ""]))
    return folder / "anytime.md"


def _comparison(curves: Mapping[str, Curve]) -> list[str]:
    """Tabulate the quality at given times, the time to reach given qualities, and the leading setting at each time."""
    start, end = min(c[0][0] for c in curves.values()), max(c[0][-1] for c in curves.values())
    low, high = min(c[1][0] for c in curves.values()), max(c[1].max() for c in curves.values())
    qualities, times = [], []
    for name, curve in curves.items():
        row: dict[str, Any] = {"overrides": name}
        last = {"end": f"{curve[0][-1]:.3g} s", "best": f"{curve[1].max():.2f}"}
        qualities.append(row | {f"{t:g} s": quality_at(curve, t) for t in TIMES if start <= t <= end} | last)
        times.append(row | {f"{level} dB": time_to(curve, level) for level in LEVELS if low <= level <= high})
    changes = [{"from": f"{time:.3g} s", "ahead": name} for time, name in leaders(curves)]
    two = dict.fromkeys([*qualities[0], *times[0]], 2)
    return [
        "PSNR in dB after the given seconds; the last columns give the end of a run and its PSNR.", "",
        markdown_table(qualities, two), "",
        "Seconds until a PSNR was reached, not before the first measurement.", "",
        markdown_table(times, two), "",
        f"The leader at each time (by more than {LEAD} dB).", "",
        markdown_table(changes, align="rl"),
    ]  # fmt: skip


def write_curves(folder: Path, frame: DataFrame) -> Path | None:
    """Plot PSNR against time in ``curves.png``, with thin lines for runs and thick lines for means over seeds.

    If there are more than ``MOST_CURVES`` settings, only those that were in the lead at some time are coloured. Returns
    None if there are fewer than two curves.
    """
    images = [(image, curves) for image, curves in curves_by_image(frame).items() if len(curves) > 1][:MOST_IMAGES]
    if not images:
        return None
    figure = plotting.new_figure(FIGURE_SIZE[1] * len(images))
    for axes, (image, curves) in zip(figure.subplots(len(images), squeeze=False)[:, 0], images, strict=True):
        _draw_curves(axes, curves)
        axes.set_title(plotting.without_math(image), fontsize=11, loc="left", color=INK)
    plotting.add_title(figure, folder, run_count(frame))
    return plotting.save_figure(figure, folder / "curves.png")


def _draw_curves(axes: Axes, curves: Mapping[str, list[Curve]]) -> None:
    plotting.tidy(axes)
    means = {label: mean_curve(alike) for label, alike in curves.items()}
    coloured = list(curves)
    if len(coloured) > MOST_CURVES:
        coloured = list(dict.fromkeys(label for _, label in leaders(means)))[-MOST_CURVES:]
    for label in curves.keys() - set(coloured):
        axes.plot(*means[label], linewidth=0.8, color=FAINT)
    for k, label in enumerate(coloured):
        look: dict[str, Any] = {"color": COLORS[k % len(COLORS)], "linestyle": DASHES[k // len(COLORS)]}
        for curve in curves[label] if len(curves[label]) > 1 else ():
            axes.plot(*curve, linewidth=0.7, alpha=0.4, **look)
        axes.plot(*means[label], linewidth=1.8, label=plotting.label_lines(label, 40), **look)
    plotting.fit_scale(axes, "x", [float(seconds[-1]) for alike in curves.values() for seconds, _ in alike])
    axes.set(xlabel="wall time of the optimisation, s", ylabel="PSNR, dB")
    heading = "settings that led at some time; the others are grey" if len(coloured) < len(curves) else None
    columns = 1 + (len(coloured) - 1) // 16
    axes.legend(title=heading, loc="upper left", bbox_to_anchor=(1.01, 1), fontsize=9, frameon=False, ncols=columns)
