"""Convert measured values and differences to table rows and to plain data."""

import math
from collections.abc import Mapping
from typing import Any

from brushexp_recovery.measure.intervals import LEVEL, Interval, is_apart
from brushexp_recovery.measure.measures import MEASURES

Figures = Mapping[str, Mapping[str, Interval]]  # by area or painting, and by `MEASURES`

DIRECTIONS = "Directions run clockwise from horizontal: 45° falls to the right."
MEANING = (
    "Each figure is the median over the photograph and small changes of it (scale, rotation, compression, tone). In "
    "each view, strokes are sampled by their confidence. Unless correct=false, the errors that recovery makes on "
    "known paintings are added to each sample. 90 % of these samples lie between low and high, so the interval "
    "includes the error of recovery. Found is the figure without these errors."
)
APART = "The first painting minus the second: a figure is apart if the interval of its difference excludes 0."


def figure_rows(figures: Figures, mm: float | None) -> list[dict[str, Any]]:
    """List the measures of all areas, one per row, with the area (``of``), intervals and standard deviations."""
    return [{"of": of, **row} for of, intervals in figures.items() for row in interval_rows(intervals, mm)]


def interval_rows(intervals: Mapping[str, Interval], mm: float | None) -> list[dict[str, Any]]:
    """List the measures of one area, one per row, with intervals and standard deviations."""
    return [
        {
            "measure": MEASURES[name].name,
            "unit": MEASURES[name].unit_in(mm),
            "value": format_number(one.value),
            "low": format_number(one.low),
            "high": format_number(one.high),
            "found": format_number(one.found),
            "sd over strokes": format_number(one.over_strokes),
            "sd over views": format_number(one.over_views),
        }
        for name, one in intervals.items()
    ]


def difference_rows(differences: Mapping[str, Interval], mm: float | None) -> list[dict[str, Any]]:
    """List the differences between two paintings, and whether the interval of each difference excludes 0."""
    return [
        {
            "measure": MEASURES[name].name,
            "unit": MEASURES[name].unit_in(mm),
            "apart": "yes" if is_apart(one) else "no",
            "difference": format_number(one.value),
            "low": format_number(one.low),
            "high": format_number(one.high),
        }
        for name, one in differences.items()
    ]


def format_number(value: float) -> str | None:
    """Format a number with three digits and at most five decimals; return None if it is not finite."""
    if not math.isfinite(value):
        return None
    if abs(value) >= 1000:
        return f"{value:.0f}"
    return f"{value:.5f}" if 0 < abs(value) < 0.001 else f"{value:.3g}"


def plain_data(figures: Figures, differences: Mapping[str, Interval] | None, mm: float | None) -> dict[str, Any]:
    """Collect measured values, intervals and differences as plain data for JSON."""
    data: dict[str, Any] = {"mm_per_px": mm, "directions": DIRECTIONS, "interval": LEVEL}
    for of, intervals in figures.items():
        data.setdefault("measures", {})[of] = {
            name: {"unit": MEASURES[name].unit_in(mm), **vars(one)} for name, one in intervals.items()
        }
    if differences is not None:
        data["differences"] = {name: {**vars(one), "apart": is_apart(one)} for name, one in differences.items()}
    return data
