"""Quality against time: what each setting had reached when, and when it had reached what; so two compare fairly."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from brushexp.reporting import plotting
from brushexp.reporting.plotting import COLORS, DASHES, FAINT, INK, SIZE
from brushexp.reporting.tables import markdown_table
from brushexp.results.tables import run_count
from brushexp.system.files import write_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from pandas import DataFrame

Curve = tuple[np.ndarray, np.ndarray]  # seconds of optimisation, rising, and PSNR in dB
TIMES = (0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 60, 120, 300, 600, 1800)  # seconds
LEVELS = (15, 20, 25, 28, 30, 33, 36, 40, 45)  # dB
LEAD = 0.1  # dB: by so much a run must be better than the one ahead to take its place
MOST_CURVES = len(COLORS) * len(DASHES)  # that can be told apart
MOST_IMAGES = 6  # in a plot


def curve_from(points: Any) -> Curve | None:
    """The curve of pairs that a run has noted as ``anytime``; None if it has no two points."""
    try:
        found = np.array(points or [], float).reshape(-1, 2)
    except (TypeError, ValueError, OverflowError):
        return None
    found = found[np.isfinite(found).all(1)]
    found = found[found[:, 0].argsort(kind="stable")]
    return (found[:, 0], found[:, 1]) if len(found) > 1 else None


def mean_curve(curves: Sequence[Curve]) -> Curve:
    """The mean PSNR of several runs from when all have begun; one that has ended keeps what it has."""
    times = np.unique(np.concatenate([seconds for seconds, _ in curves]))
    times = times[times >= max(seconds[0] for seconds, _ in curves)]
    return times, np.mean([np.interp(times, *curve) for curve in curves], axis=0)


def quality_at(curve: Curve, seconds: float, *, kept: bool = False) -> float | None:
    """The best PSNR in dB up to a time, between two points as on a line; None before the first and after the last.

    With ``kept``, what has ended keeps what it has.
    """
    times, psnr = curve
    if not times[0] <= seconds <= (math.inf if kept else times[-1]):
        return None
    return float(np.interp(seconds, times, np.maximum.accumulate(psnr)))


def time_to(curve: Curve, psnr: float) -> float | None:
    """The seconds until a PSNR in dB was reached, likewise; at the earliest those of the first point. None if never."""
    times, best = curve[0], np.maximum.accumulate(curve[1])
    k = int(np.searchsorted(best, psnr))
    around = slice(max(k - 1, 0), k + 1)
    return None if k == len(best) else float(np.interp(psnr, best[around], times[around]))


def ahead(curves: Mapping[str, Curve]) -> list[tuple[float, str]]:
    """Who had the best picture when: the seconds from which on, and the name; a finished run keeps what it has."""
    leader: str | None = None
    found: list[tuple[float, str]] = []
    best = {name: np.maximum.accumulate(psnr) for name, (_, psnr) in curves.items()}
    for time in np.unique(np.concatenate([seconds for seconds, _ in curves.values()])):
        now = {name: np.interp(time, curve[0], best[name]) for name, curve in curves.items() if time >= curve[0][0]}
        first = max(now, key=lambda name: now[name])
        if leader is None or now[first] > now[leader] + LEAD:
            leader = first
            found.append((float(time), first))
    return found


def curves_by_image(frame: DataFrame) -> dict[str, dict[str, list[Curve]]]:
    """Image -> label of a setting -> the curves of its runs, without those that left none."""
    found: dict[str, dict[str, list[Curve]]] = {}
    for image, label, points in frame["run"][["image", "label", "anytime"]].dropna(subset=["label"]).to_numpy():
        if (curve := curve_from(points)) is not None:
            found.setdefault(image, {}).setdefault(label, []).append(curve)
    return found


def mean_curves(curves: Mapping[str, list[Curve]]) -> dict[str, Curve]:
    """The mean over seeds of each setting."""
    means = {label: mean_curve(alike) for label, alike in curves.items()}
    return {label: curve for label, curve in means.items() if len(curve[0]) > 1}


def write_anytime(folder: Path, frame: DataFrame) -> Path | None:
    """Write ``anytime.md``, quality at equal time and time to equal quality; None if no two settings left curves."""
    found = {image: mean_curves(curves) for image, curves in curves_by_image(frame).items()}
    lines = ["Seconds of optimisation; a run keeps the best picture it has had. Means over seeds."]
    for image, curves in found.items():
        if len(curves) > 1:
            lines += ["", f"## {image}", "", *_comparison(curves)]
    if len(lines) == 1:
        return None
    write_text(folder / "anytime.md", "\n".join([*lines, ""]))
    return folder / "anytime.md"


def _comparison(curves: Mapping[str, Curve]) -> list[str]:
    """Quality at some times, time to some qualities, and who is ahead when."""
    start, end = min(c[0][0] for c in curves.values()), max(c[0][-1] for c in curves.values())
    low, high = min(c[1][0] for c in curves.values()), max(c[1].max() for c in curves.values())
    qualities, times = [], []
    for name, curve in curves.items():
        found: dict[str, Any] = {f"{time:g} s": quality_at(curve, time) for time in TIMES if start <= time <= end}
        last = {"end": f"{curve[0][-1]:.3g} s", "best": f"{curve[1].max():.2f}"}
        qualities.append({"overrides": name} | found | last)
        found = {f"{level} dB": time_to(curve, level) for level in LEVELS if low <= level <= high}
        times.append({"overrides": name} | found)
    leaders = [{"from": f"{time:.3g} s", "ahead": name} for time, name in ahead(curves)]
    two = dict.fromkeys([*qualities[0], *times[0]], 2)
    return [
        "PSNR in dB after so many seconds; the last columns: when a run ended, and with what.", "",
        markdown_table(qualities, two), "",
        "Seconds until a PSNR was reached, at the earliest those of the first measurement.", "",
        markdown_table(times, two), "",
        f"Who is ahead when (by more than {LEAD} dB).", "",
        markdown_table(leaders, align="rl"),
    ]  # fmt: skip


def write_curves(folder: Path, frame: DataFrame) -> Path | None:
    """Write ``curves.png``: thin lines are runs, thick ones means over seeds; None if no two settings left curves.

    Of more settings than can be told apart, those are coloured that were ahead at some time.
    """
    found = {image: curves for image, curves in curves_by_image(frame).items() if len(curves) > 1}
    if not found:
        return None
    shown = list(found.items())[:MOST_IMAGES]
    figure = plotting.new_figure(SIZE[1] * len(shown))
    for axes, (image, curves) in zip(figure.subplots(len(shown), squeeze=False)[:, 0], shown, strict=True):
        _draw_curves(axes, curves)
        axes.set_title(plotting.without_math(image), fontsize=11, loc="left", color=INK)
    plotting.entitle(figure, folder, run_count(frame))
    return plotting.save_figure(figure, folder / "curves.png")


def _draw_curves(axes: Axes, curves: Mapping[str, list[Curve]]) -> None:
    plotting.tidy(axes)
    means = {label: mean_curve(alike) for label, alike in curves.items()}
    shown = list(curves)
    if len(shown) > MOST_CURVES:
        shown = list(dict.fromkeys(label for _, label in ahead(means)))[-MOST_CURVES:]
    for label in curves.keys() - set(shown):
        axes.plot(*means[label], linewidth=0.8, color=FAINT)
    for k, label in enumerate(shown):
        look: dict[str, Any] = {"color": COLORS[k % len(COLORS)], "linestyle": DASHES[k // len(COLORS)]}
        for curve in curves[label] if len(curves[label]) > 1 else ():
            axes.plot(*curve, linewidth=0.7, alpha=0.4, **look)
        axes.plot(*means[label], linewidth=1.8, label=plotting.label_lines(label, 40), **look)
    plotting.fit_scale(axes, "x", [float(seconds[-1]) for alike in curves.values() for seconds, _ in alike])
    axes.set_xlabel("wall time of the optimisation, s", fontsize=10)
    axes.set_ylabel("PSNR, dB", fontsize=10)
    heading = "ahead at some time; the others are grey" if len(shown) < len(curves) else None
    columns = 1 + (len(shown) - 1) // 16
    axes.legend(title=heading, loc="upper left", bbox_to_anchor=(1.01, 1), fontsize=9, frameon=False, ncols=columns)
