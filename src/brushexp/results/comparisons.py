"""Let packages compare the runs of a sweep, in files next to the sweep's page and in tables on it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from brushexp.registry.plugin import import_or_explain
from brushexp.system.published import entry_points_of

if TYPE_CHECKING:
    from pandas import DataFrame

COMPARISONS = "brushexp.comparisons"  # entry-point group of instances of `RunComparison`


@dataclass(frozen=True)
class PageTable:
    """A table on a sweep's page, with an ``id``, a title, an explanation and at least one row."""

    id: str
    title: str
    text: str
    rows: list[dict[str, Any]]
    numbers: Sequence[str] = ()  # columns to align as numbers


@dataclass(frozen=True)
class RunComparison:
    """A way to compare the runs in a data frame of `brushexp.results.runs`: it writes files and may make a table."""

    write: Callable[[Path, DataFrame], None]
    table: Callable[[DataFrame], PageTable | None]


def comparisons() -> list[RunComparison]:
    """Load the comparisons that installed packages provide; raise a UserError if one cannot be imported."""
    points = entry_points_of(COMPARISONS).values()
    return [import_or_explain(point.load, f"entry point {point.name} ({point.value})") for point in points]
