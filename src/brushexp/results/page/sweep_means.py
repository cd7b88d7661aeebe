"""Means over seeds, as the page of a sweep shows them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from statistics import mean

from brushexp.results.effect import mean_and_spread
from brushexp.results.page.sweep_rows import MOST_COLUMNS, NOT_SET, Metric
from brushexp.results.runs import NO_SETTINGS
from brushexp.results.table import Result, groups, numbers, shortened, varying


@dataclass(frozen=True)
class Mean:
    """Finished runs that differ in the seed alone, as one row.

    Attributes:
        chosen: the values of the other settings that vary; of more than four, one text of those that are set.
        runs: how many.
        cells: of each metric what is written: mean and standard deviation.
        numbers: of each metric the mean.
    """

    chosen: tuple[str, ...]
    runs: int
    cells: dict[str, str]
    numbers: dict[str, float]


def means_of(results: list[Result], metrics: Sequence[Metric]) -> tuple[list[str], list[Mean]]:
    """Means of the finished runs that differ in the seed alone; nothing if seeds do not vary.

    Returns:
        heads of the settings that vary beside the seed, and the means of each of their combinations.
    """
    axes = varying(results)
    if "seed" not in axes:
        return [], []
    words = {key: shortened(values) for key, values in axes.items() if key not in NO_SETTINGS}
    means = []
    for chosen, runs in groups(results, list(words)).items():
        found = {metric.key: n for metric in metrics if (n := numbers(runs, metric.key))}
        cells = {metric.key: _told(found[metric.key], metric.digits) for metric in metrics if metric.key in found}
        values = _columns({key: words[key][value] for key, value in zip(words, chosen, strict=True)})
        means.append(Mean(values, len(runs), cells, {key: mean(n) for key, n in found.items()}))
    return (list(words) if len(words) <= MOST_COLUMNS else ["settings"]), means


def _columns(chosen: dict[str, str]) -> tuple[str, ...]:
    """A column for each setting, or one for all that are set where there are too many."""
    if len(chosen) <= MOST_COLUMNS:
        return tuple(value or NOT_SET for value in chosen.values())
    return (" ".join(f"{key}={value}" for key, value in chosen.items() if value) or "default",)


def _told(found: list[float], digits: int) -> str:
    """Mean, and standard deviation where there is one."""
    middle, spread = mean_and_spread(found)
    return f"{middle:.{digits}f}" + f" ± {spread:.{digits}f}" * (len(found) > 1)
