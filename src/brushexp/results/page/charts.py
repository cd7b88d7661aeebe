"""The numbers behind the charts of a run's page, as plain data that ``run_charts.js`` draws."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

MAX_POINTS = 400  # of a line: more cannot be seen
BINS = 28
TAIL_QUANTILE = 0.99  # the largest values beyond it share the last bar
SECTORS = 18  # of half a turn

Chart = dict[str, Any]  # kind, title and summary (a sentence for those who cannot see it), and what the kind needs


def line_chart(title: str, x: Sequence[float], y: Sequence[float], x_label: str, unit: str = "") -> Chart | None:
    """A curve; None if it has no two points that can be drawn, or not as many of x as of y.

    Args:
        title: what goes up and down.
        x: rising.
        y: as many; an axis of positive numbers that differ by much is logarithmic, unless they have a unit.
        x_label: of the axis.
        unit: of y.
    """
    if len(x) != len(y):
        return None
    points = np.array([x, y], float)
    points = points[:, np.isfinite(points).all(0)]
    if points.shape[1] < 2 or points[0, 0] == points[0, -1]:
        return None
    if points.shape[1] > MAX_POINTS:
        points = points[:, np.linspace(0, points.shape[1] - 1, MAX_POINTS).round().astype(int)]
    first, last = (f"{value:.4g}" for value in points[1, [0, -1]])
    return {
        "kind": "line",
        "title": f"{title}, {unit}" if unit else title,
        "summary": f"{title}: from {first} to {last} {unit}".rstrip() + f" at {points[0, -1]:,.6g} {x_label}",
        "x": _rounded(points[0]),
        "y": _rounded(points[1]),
        "x_label": x_label,
        "unit": unit,
    }


def histogram_chart(title: str, values: np.ndarray, x_label: str) -> Chart | None:
    """How many strokes have which value (N,), >= 0; the median is marked. None if there are none."""
    values = values[np.isfinite(values)]
    if not len(values):
        return None
    largest, median = float(values.max()), float(np.median(values))
    end = float(np.quantile(values, TAIL_QUANTILE)) or largest or 1.0
    if largest < 1.15 * end:
        end = largest or 1.0
    counts, _ = np.histogram(np.minimum(values, end), BINS, (0.0, end))
    return {
        "kind": "histogram",
        "title": title,
        "summary": f"{title}: half of the strokes are below {median:.3g}; {x_label}",
        "counts": counts.tolist(),
        "end": end,
        "largest": largest,
        "median": median,
        "x_label": x_label,
    }


def rose_chart(title: str, angles: np.ndarray, lengths: np.ndarray) -> Chart | None:
    """Share of the strokes' length by direction, in sectors of a circle; None without directions.

    Args:
        title: above it.
        angles: (N,) radians in [0, pi), clockwise from the x axis as seen; NaN for none.
        lengths: (N,) >= 0.
    """
    kept = np.isfinite(angles) & (lengths > 0)
    if not kept.any():
        return None
    step = math.pi / SECTORS
    sector = ((angles[kept] + step / 2) / step).astype(int) % SECTORS  # the first one is centred on 0
    shares = np.bincount(sector, lengths[kept], SECTORS)
    peak = math.degrees(int(shares.argmax()) * step)
    return {
        "kind": "rose",
        "title": title,
        "summary": f"Directions: most of the length lies near {peak:.0f} degrees",
        "shares": _rounded(shares / shares.sum()),
        "note": "Share of the strokes' length by direction; 45° falls to the right.",
    }


def _rounded(values: np.ndarray) -> list[float]:
    """Numbers with as many digits as a chart can show."""
    return [float(f"{value:.6g}") for value in values]
