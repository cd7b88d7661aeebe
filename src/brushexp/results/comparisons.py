"""Comparisons of runs that packages provide, as files next to a sweep's page and tables on the page."""

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
    """A section of a sweep's page, with an ``id``, a title, an explanation and at least one row of text."""

    id: str
    title: str
    text: str
    rows: list[dict[str, Any]]
    numbers: Sequence[str] = ()  # columns to align as numbers


@dataclass(frozen=True)
class RunComparison:
    """A comparison of runs in a data frame of `brushexp.results.runs`, as files and optionally a table."""

    write: Callable[[Path, DataFrame], None]
    table: Callable[[DataFrame], PageTable | None]


def comparisons() -> list[RunComparison]:
    """Load the comparisons that installed packages provide; raise a UserError if one cannot be imported."""
    points = published(COMPARISONS).values()
    return [import_or_explain(point.load, f"entry point {point.name} ({point.value})") for point in points]
