"""Quality against time: what each run had reached when, and when it had reached what; so two can be compared fairly."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from brushexp.results.runs import Picture, by_picture, paintings
from brushexp.results.table import NOTHING, Result, collect, markdown
from brushexp.system.files import write_text

Curve = tuple[np.ndarray, np.ndarray]  # seconds of optimisation, rising, and PSNR in dB
TIMES = (0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 60, 120, 300, 600, 1800)  # seconds
LEVELS = (15, 20, 25, 28, 30, 33, 36, 40, 45)  # dB
LEAD = 0.1  # dB: by so much a run must be better than the one ahead to take its place


def curve_of(result: Result) -> Curve | None:
    """The curve that a run has noted as ``anytime``; None if it has no two points."""
    try:
        points = np.array(result.get("anytime") or [], float).reshape(-1, 2)
    except (TypeError, ValueError):
        return None
    points = points[np.isfinite(points).all(1)]
    points = points[points[:, 0].argsort(kind="stable")]
    return (points[:, 0], points[:, 1]) if len(points) > 1 else None


def mean_curve(curves: list[Curve]) -> Curve:
    """The mean PSNR of several runs from when all have begun; one that has ended keeps what it has."""
    times = np.unique(np.concatenate([seconds for seconds, _ in curves]))
    times = times[times >= max(seconds[0] for seconds, _ in curves)]
    return times, np.mean([np.interp(times, *curve) for curve in curves], axis=0)


def quality_at(curve: Curve, seconds: float) -> float | None:
    """The best PSNR in dB up to a time, between two points as on a line; None before the first and after the last."""
    times, psnr = curve
    if not times[0] <= seconds <= times[-1]:
        return None
    return float(np.interp(seconds, times, np.maximum.accumulate(psnr)))


def time_to(curve: Curve, psnr: float) -> float | None:
    """The seconds until a PSNR in dB was reached, likewise; None if a run never was as good, or from the start."""
    times, best = curve[0], np.maximum.accumulate(curve[1])
    k = int(np.searchsorted(best, psnr))
    if k == len(best) or (k == 0 and best[0] > psnr):
        return None
    if k == 0:
        return float(times[0])
    share = (psnr - best[k - 1]) / (best[k] - best[k - 1])
    return float(times[k - 1] + share * (times[k] - times[k - 1]))


def ahead(curves: Mapping[str, Curve]) -> list[tuple[float, str]]:
    """Who had the best picture when: the seconds from which on, and the name; a finished run keeps what it has."""
    leader: str | None = None
    found: list[tuple[float, str]] = []
    best = {name: np.maximum.accumulate(psnr) for name, (_, psnr) in curves.items()}
    for time in np.unique(np.concatenate([seconds for seconds, _ in curves.values()])):
        now = {
            name: float(np.interp(time, seconds, best[name]))
            for name, (seconds, _) in curves.items()
            if time >= seconds[0]
        }
        first = max(now, key=lambda name: now[name])
        if leader is None or now[first] > now[leader] + LEAD:
            leader = first
            found.append((float(time), first))
    return found


def curves_of(picture: Picture) -> dict[str, Curve]:
    """The mean curve of every setting that has left one, by its label."""
    found = {}
    for setting in picture.settings:
        curves = [curve for run in setting.runs if (curve := curve_of(run)) is not None]
        if curves and len((mean := mean_curve(curves))[0]) > 1:
            found[setting.label] = mean
    return found


def write_anytime(folder: Path, results: list[Result] | None = None) -> Path | None:
    """Write ``anytime.md``, quality at equal time and time to equal quality; None if no two settings left curves.

    Args:
        folder: where to.
        results: of which runs; None means those of the sweep in this folder.
    """
    pictures = by_picture(folder, paintings(collect(folder) if results is None else results))
    found = {picture.name: curves for picture in pictures if len(curves := curves_of(picture)) > 1}
    if not found:
        return None
    lines = ["Seconds of optimisation; a run keeps the best picture it has had. Means over seeds."]
    for name, curves in found.items():
        lines += ["", f"## {name}", "", *_qualities(curves), "", *_times(curves), "", *_leaders(curves)]
    write_text(folder / "anytime.md", "\n".join([*lines, ""]))
    return folder / "anytime.md"


def _qualities(curves: Mapping[str, Curve]) -> list[str]:
    """PSNR at some times, and at the end."""
    starts, ends = [c[0][0] for c in curves.values()], [c[0][-1] for c in curves.values()]
    times = [time for time in TIMES if min(starts) <= time <= max(ends)]
    rows = []
    for name, curve in curves.items():
        cells = [quality_at(curve, time) for time in times]
        shown = [
            f"{psnr:.2f}" if psnr is not None else "ended" if time > curve[0][-1] else NOTHING
            for time, psnr in zip(times, cells, strict=True)
        ]
        rows.append([name, *shown, f"{curve[0][-1]:.3g} s", f"{curve[1].max():.2f}"])
    text = "PSNR in dB after so many seconds; the last columns: when a run ended, and with what."
    return [text, "", *_table([*(f"{time:g} s" for time in times), "end", "best"], rows)]


def _times(curves: Mapping[str, Curve]) -> list[str]:
    """Seconds to some qualities, of those that some run reached on its way."""
    found = {level: [time_to(curve, level) for curve in curves.values()] for level in LEVELS}
    levels = [level for level, times in found.items() if any(time is not None for time in times)]
    rows = []
    for k, (name, curve) in enumerate(curves.items()):
        cells = [found[level][k] for level in levels]
        shown = [
            f"{time:.2f}" if time is not None else "at once" if curve[1][0] > level else NOTHING
            for level, time in zip(levels, cells, strict=True)
        ]
        rows.append([name, *shown])
    return ["Seconds until a PSNR was reached.", "", *_table([f"{level} dB" for level in levels], rows)]


def _leaders(curves: Mapping[str, Curve]) -> list[str]:
    rows = [[f"{time:.3g} s", name] for time, name in ahead(curves)]
    text = f"Who is ahead when (by more than {LEAD} dB)."
    return [text, "", *markdown([["from", "ahead"], ["---:", "---"], *rows])]


def _table(head: list[str], rows: list[list[str]]) -> list[str]:
    return markdown([["overrides", *head], ["---", *("---:" for _ in head)], *rows])
