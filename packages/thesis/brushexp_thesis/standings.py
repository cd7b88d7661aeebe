"""Compare painters on the same pictures by means with intervals, for equal numbers of strokes and for equal times.

A row is a painter with its settings and number of strokes. A section is a set of pictures together with the painters
that painted all of them, so that all means in a section are over the same pictures. Published figures are listed but
are not part of any mean.
"""

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path, PurePath
from typing import Any

import numpy as np
from brushexp_studies.anytime import TIMES, quality_at
from brushexp_studies.paired import interval
from pandas import DataFrame

from brushexp.contracts import plugins
from brushexp.contracts.results import (
    MISSING,
    Curve,
    Quantity,
    curve_from,
    differences,
    image_name,
    mean_curve,
    quantities,
    setting_of,
    words_of,
)
from brushexp.contracts.runs import UNFINISHED
from brushexp_thesis.published import PublishedFigures

SHOWN = ["psnr", "ssim", "ms_ssim", "l1", "perceptual", "lpips_alexnet", "lpips_squeeze", "lpips_vgg16"]
SHOWN += ["bits", "psnr_decoded", "seconds", "cpu_seconds"]
COLUMNS = {key: quantities()[key] for key in SHOWN} | {"peak_memory_mb": Quantity("memory, MB", 0, "lower")}
IGNORED_KEYS = {
    *("image", "pictures", "seed", "painter", "strokes", "task"),  # these define rows and sections
    *("output", "overwrite", "resume", "report", "frames", "frame_side", "timelapse", "timelapse_seconds", "logger"),
    *("checkpoint_every", "metric"),
}  # keys that do not distinguish two rows


def name_with_author(painter: str) -> str:
    """Append the original author to the name of a re-implemented painter, or of a preset of such a painter.

    A preset's name begins with its painter's name.

    >>> name_with_author("hertzmann_wash"), name_with_author("gradient"), name_with_author("gone")
    ('hertzmann_wash (after Hertzmann)', 'gradient', 'gone')
    """
    known = {plugin.name: plugin for plugin in plugins("painter")}
    chosen = known.get(painter) or known.get(painter.partition("_")[0])
    author = getattr(chosen.cls, "author", "") if chosen else ""
    return f"{painter} (after {author})" if author else painter


@dataclass(frozen=True)
class Entry:
    """A finished painting that is listed on a leaderboard."""

    key: tuple[str, tuple[str, ...], int | None]  # painter, settings that are not common to all, requested strokes
    target: str  # fingerprint of the painted picture
    name: str  # name of the target, with its size
    strokes: float | None
    numbers: Mapping[str, float]  # metrics with the names in COLUMNS
    curve: Curve | None
    folder: Path
    command: str  # command that repeats the painting; "" if unknown


@dataclass(frozen=True)
class Row:
    """A painter's results on the pictures of a section; ``numbers`` holds each picture's mean over seeds."""

    painter: str
    settings: str
    strokes: float | None  # requested number of strokes, or the mean number painted
    numbers: Mapping[str, np.ndarray]  # metrics that are known for every picture
    curves: Sequence[Curve]  # one for each picture, or none if any picture lacks one
    entries: Sequence[Entry]  # entries of the first seed, one for each picture

    @property
    def words(self) -> dict[str, str]:
        return {"painter": name_with_author(self.painter), "settings": self.settings, "strokes": count_of(self.strokes)}

    @property
    def label(self) -> str:
        return " ".join(filter(None, (self.painter, self.settings)))

    def psnr_at(self, seconds: float) -> list[float]:
        """Return each picture's PSNR in dB after ``seconds``, or its final PSNR if the painting ended earlier.

        The list is empty if any picture's curve starts after ``seconds``.
        """
        psnr = [quality_at(curve, seconds, after_end=True) for curve in self.curves]
        return [] if None in psnr else psnr  # type: ignore[return-value]


@dataclass(frozen=True)
class Section:
    """A set of pictures, its rows sorted by strokes and then PSNR, and figures published for these pictures."""

    pictures: Mapping[str, str]  # target -> name with its size
    rows: Sequence[Row]
    published: Sequence[PublishedFigures]

    @property
    def stems(self) -> list[str]:
        return [stem_of(name) for name in self.pictures.values()]

    @property
    def title(self) -> str:
        names, stems = list(self.pictures.values()), self.stems
        if len(names) == 1:
            return names[0]
        sizes = {name.rpartition(", ")[2] for name in names}
        listed = ", ".join(stems if len(stems) <= 6 else [*stems[:4], "...", stems[-1]])
        return f"{len(names)} pictures: {listed}" + (f"; {sizes.pop()} each" if len(sizes) == 1 else "")

    @cached_property
    def times(self) -> list[float]:
        """The times in seconds at which rows are compared; empty if fewer than two rows have curves."""
        curves = [curve for row in self.rows for curve in row.curves]
        if sum(bool(row.curves) for row in self.rows) < 2:
            return []
        start, end = min(c[0][0] for c in curves), max(c[0][-1] for c in curves)
        return [time for time in TIMES if start <= time <= end][-7:]

    def against_best(self, row: Row) -> tuple[float, float, float] | None:
        """Compute the mean PSNR difference, with its bounds, from the best row with the same number of strokes.

        Returns None if this is the best row itself, or if its PSNR or number of strokes is unknown.
        """
        rivals = [one for one in self.rows if one.strokes == row.strokes and "psnr" in one.numbers]
        best = max(rivals, key=lambda one: one.numbers["psnr"].mean(), default=row)
        is_comparable = row.strokes is not None and "psnr" in row.numbers and best is not row
        return interval(row.numbers["psnr"] - best.numbers["psnr"]) if is_comparable else None

    def relation(self, figures: PublishedFigures) -> str:
        """Describe how the pictures behind published figures relate to the section's pictures."""
        shared = len({*figures.of.names} & {*self.stems})
        if shared == len(figures.of.names) == len(self.pictures):
            return "the same pictures"
        return f"{figures.of.pictures} ({shared} picture{'s' * (shared != 1)} here)"


def count_of(strokes: float | None) -> str:
    """Format a number of strokes, or a dash if it is unknown."""
    return MISSING if strokes is None else f"{strokes:,.0f}"


def stem_of(name: str) -> str:
    """Return a picture's file name without its suffix: ``kodim03`` for ``kodim03.png, 768 x 512 pixels``."""
    return PurePath(name.rpartition(", ")[0] or name).stem


def entries_of(frame: DataFrame) -> list[Entry]:
    """List the finished paintings among the runs in a data frame from `brushexp.results.runs`.

    Paintings without a target.png are left out.
    """
    runs = [
        (run, metrics)
        for name, run in frame["run"].iterrows()
        if run["status"] not in UNFINISHED and run["picture"] and (run["folder"] / "target.png").is_file()
        if isinstance((metrics := dict(frame["metric"].loc[name].dropna())).get("psnr"), int | float)
        if "l1" in metrics
    ]
    chosen = [
        {k: v for k, v in run["overrides"].items() if k not in IGNORED_KEYS and not k.startswith("hydra")}
        for run, _ in runs
    ]
    return [_entry(*one, settings) for one, settings in zip(runs, differences(chosen), strict=True)]


def _entry(run: Any, metrics: Mapping[str, Any], settings: tuple[str, ...]) -> Entry:
    budget = str(setting_of(run, "strokes"))
    painter = run["overrides"].get("painter") or metrics.get("painter", "gradient")  # a preset has its own name
    return Entry(
        key=(str(painter), settings, int(budget) if budget.isdecimal() else None),
        target=run["target"],
        name=image_name(run),
        strokes=metrics.get("n_strokes"),
        numbers={key: float(metrics[key]) for key in COLUMNS if isinstance(metrics.get(key), int | float)},
        curve=curve_from(run["anytime"]),
        folder=run["folder"],
        command=run["command"] if words_of(run["folder"]) else "",
    )


def sections_of(entries: Sequence[Entry], published: Sequence[PublishedFigures] = ()) -> list[Section]:
    """Make a section for every set of pictures that a painter has painted.

    Larger sets come first; among sets of equal size, those with published figures come first.
    """
    by_painter: dict[Any, dict[str, list[Entry]]] = {}
    for entry in entries:
        by_painter.setdefault(entry.key, {}).setdefault(entry.target, []).append(entry)
    names = {entry.target: entry.name for entry in reversed(entries)}
    sections = []
    for targets in sorted({frozenset(one) for one in by_painter.values()}, key=lambda one: (-len(one), sorted(one))):
        pictures = {target: names[target] for target in sorted(targets, key=names.__getitem__)}
        chosen = {key: [one[t] for t in pictures] for key, one in by_painter.items() if targets <= one.keys()}
        common = set.intersection(*(set(settings) for _, settings, _ in chosen)) if len(chosen) > 1 else set()
        rows = [_row(key, alike, common) for key, alike in chosen.items()]
        rows.sort(key=lambda row: (row.strokes or math.inf, -row.numbers.get("psnr", np.zeros(1)).mean()))
        sections.append(Section(pictures, rows, [one for one in published if _is_related(one, pictures.values())]))
    return sorted(sections, key=lambda section: (-len(section.pictures), not section.published))


def _row(
    key: tuple[str, tuple[str, ...], int | None], alike: Sequence[Sequence[Entry]], common: Collection[str]
) -> Row:
    """Average a painter's figures over seeds, separately for each picture.

    Settings that are ``common`` to all rows are left out of the row's label.
    """
    painter, settings, budget = key
    every = [entry for one in alike for entry in one]
    counts = [entry.strokes for entry in every if entry.strokes is not None]
    columns = [column for column in COLUMNS if all(column in entry.numbers for entry in every)]
    curves = [[entry.curve for entry in one if entry.curve is not None] for one in alike]
    return Row(
        painter,
        " ".join(setting for setting in settings if setting not in common),
        budget or (float(np.mean(counts)) if counts else None),
        {column: np.array([np.mean([entry.numbers[column] for entry in one]) for one in alike]) for column in columns},
        [mean_curve(one) for one in curves] if all(entry.curve is not None for entry in every) else [],
        [one[0] for one in alike],
    )


def _is_related(figures: PublishedFigures, names: Iterable[str]) -> bool:
    size = "{} x {} pixels".format(*figures.of.size) if len(figures.of.size) == 2 else None
    return any(stem_of(name) in figures.of.names and name.endswith(f", {size}") for name in names)
