"""What packages make of the results of several runs: files beside their page, and tables on it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from brushexp.registry.plugin import import_or_explain
from brushexp.system.published import published

if TYPE_CHECKING:
    from pandas import DataFrame

COMPARISONS = "brushexp.comparisons"  # entry-point group of instances of `RunComparison`


@dataclass(frozen=True)
class PageTable:
    """A section of the page of a sweep: its ``id`` and heading, what it shows, and at least one row, in words."""

    id: str
    title: str
    text: str
    rows: list[dict[str, Any]]
    numbers: Sequence[str] = ()  # columns to align as such


@dataclass(frozen=True)
class RunComparison:
    """What is made of runs, a frame of `brushexp.results.runs`: files in a folder, and a table, if there is one."""

    write: Callable[[Path, DataFrame], None]
    table: Callable[[DataFrame], PageTable | None]


def comparisons() -> list[RunComparison]:
    """Load the comparisons of installed packages; a UserError says which one cannot be imported."""
    points = published(COMPARISONS).values()
    return [import_or_explain(point.load, f"entry point {point.name} ({point.value})") for point in points]
