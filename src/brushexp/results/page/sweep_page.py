"""``report.html`` of a sweep, or of any runs: to sort, to filter, to put side by side, and plots to point at."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from brushexp.results.page.html import page
from brushexp.results.page.sweep_means import means_of
from brushexp.results.page.sweep_rows import Rows, rows_of
from brushexp.results.table import Result, collect, summary
from brushexp.system.files import write_text

COST = "seconds"  # what quality is plotted against


def write_sweep_page(folder: Path, results: list[Result] | None = None) -> Path:
    """Write ``report.html``.

    Args:
        folder: where to.
        results: of which runs; None means those of the sweep in this folder.
    """
    results = collect(folder) if results is None else results
    write_text(folder / "report.html", sweep_page(folder, results))
    return folder / "report.html"


def sweep_page(folder: Path, results: list[Result]) -> str:
    """The page about some runs, with their pictures in it.

    A picture has at most 640 pixels on its longer side; the more pictures, the smaller they are, so that all have
    16 million pixels together, which makes 3 to 5 MB.

    Args:
        folder: where the page will lie; the folder of each run is ``folder / run["run"]``.
        results: of at least one run.
    """
    shown = rows_of(folder, results)
    axes, means = means_of(results, shown.metrics)
    return page(
        "sweep.html.j2",
        title=folder.resolve().name,
        summary=summary(results),
        shown=shown,
        mean_axes=axes,
        means=means,
        best=best_of(shown),
        plotted=plotted(shown),
        data=data_of(shown),
    )


def best_of(shown: Rows) -> dict[str, str]:
    """How the best number of each metric is written; nothing where several pictures were painted."""
    if len(shown.pictures) > 1:
        return {}
    found = {}
    for metric in shown.metrics:
        values = {row.numbers[metric.key]: row.cells[metric.key] for row in shown.rows if metric.key in row.numbers}
        if metric.better and len(values) > 1:
            found[metric.key] = values[max(values) if metric.better == "higher" else min(values)]
    return found


def plotted(shown: Rows) -> dict[str, Any]:
    """What the plots begin with.

    Returns:
        ``x`` (metric, or a setting as ``axis:steps``) and ``y`` (metric) of the points, both "" if there are no two to
        compare; ``xs``, all that can be chosen for ``x``, with names; ``front``, whether quality is plotted against
        cost; ``curves``, whether there are curves.
    """
    judged = [metric.key for metric in shown.metrics if metric.better and metric.key != COST]
    axes = sorted((key for key in shown.axes if key != "seed"), key=lambda key: -len(shown.axes[key]))
    y = next((key for key in judged if len(_groups_with(shown, key)) > 1), "")
    front = bool(y) and len(_groups_with(shown, COST)) > 1
    costs = {metric.key: metric.name for metric in shown.metrics if len(_groups_with(shown, metric.key)) > 1}
    x = COST if front else f"axis:{axes[0]}" if y and axes else ""
    return {
        "x": x,
        "y": y if x else "",
        "xs": costs | {f"axis:{key}": key for key in axes},
        "front": front,
        "curves": any(row.curve for row in shown.rows),
    }


def data_of(shown: Rows) -> dict[str, Any]:
    """What the scripts of the page know beside what they see in it."""
    return {
        "axes": [
            {"key": key, "values": list(words), "shown": list(words.values())} for key, words in shown.filters.items()
        ],
        "metrics": [vars(metric) for metric in shown.metrics],
        "groups": [vars(group) for group in shown.groups],
        "pictures": shown.pictures,
        "rows": [
            {
                "name": row.name,
                "label": row.label,
                "chosen": [list(words).index(row.chosen.get(key, row.status)) for key, words in shown.filters.items()],
                "error": row.error,
                "cells": row.cells,
                "numbers": row.numbers,
                "command": row.command,
                "report": row.report,
                "target": row.target,
                "group": row.group,
                "curve": row.curve,
            }
            for row in shown.rows
        ],
    }


def _groups_with(shown: Rows, metric: str) -> set[int]:
    """The groups of runs of which this metric is known."""
    return {row.group for row in shown.rows if row.group is not None and metric in row.numbers}
