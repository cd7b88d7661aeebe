"""What was measured, as files: a row per stroke, a summary for programs, and one for people."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
from pandas import DataFrame

from brushexp.analysis.measures import MEASURES
from brushexp.analysis.summary import (
    OVERALL,
    Analysis,
    comparison_of,
    in_units,
    overall_of,
    statistics_of,
    summary_of,
    thinnest_of,
)
from brushexp.results.tables import MISSING, markdown_table
from brushexp.strokes.brushwork import FAINTEST
from brushexp.system.files import write_json, write_text

HEAD = ("n", "mean", "sd", "q25", "median", "q75")
WORDS = {"n": "n", "mean": "mean", "sd": "standard deviation", "q25": "25 %", "median": "median", "q75": "75 %"}
PLAIN = {"°": "deg"}  # units in a table that any program can read


def write_tables(folder: Path, found: Sequence[Analysis]) -> list[Path]:
    """Write ``brushwork.csv``, ``summary.json`` and ``summary.md`` of one painting, or of two side by side."""
    paths = []
    for one, name in zip(found, ("brushwork.csv", "brushwork_against.csv"), strict=False):
        paths.append(folder / name)
        write_text(paths[-1], as_csv(one))
    data = summary_of(found[0])
    if len(found) > 1:
        data |= {"against": summary_of(found[1]), "comparison": comparison_of(*found)}
    write_json(folder / "summary.json", data)
    write_text(folder / "summary.md", as_markdown(found))
    return [*paths, folder / "summary.json", folder / "summary.md"]


def as_csv(found: Analysis) -> str:
    """A row per stroke that counts, in the order of the catalogue; what is not defined is empty."""
    columns: dict[str, Iterable[object]] = {"stroke": found.number, "depth": found.depth}
    for key, values in found.measures.items():
        measure = MEASURES.get(key)
        unit = "px" if measure is None else PLAIN.get(measure.unit, measure.unit)
        shown = values if measure is None else in_units(values, measure)
        columns[f"{key} [{unit}]" if unit else key] = map(_cell, shown.tolist())
    file = io.StringIO()
    writer = csv.writer(file, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows(zip(*columns.values(), strict=True))
    return file.getvalue()


def _cell(value: float) -> str:
    return f"{value:.6g}" if np.isfinite(value) else ""


def as_markdown(found: Sequence[Analysis]) -> str:
    """Tables with definitions."""
    lines = [f"# Brushwork of {' and '.join(_title(one) for one in found)}", ""]
    for one in found:
        lines += [*_counted(one), ""]
    lines += [*_overall(found), ""]
    if len(found) > 1:
        lines += [*_comparison(found[0], found[1]), ""]
    for one in found:
        lines += [f"## Strokes of {_title(one)}", "", *_statistics(one), ""]
    return "\n".join([*lines, *_definitions(), ""])


def _title(found: Analysis) -> str:
    """A name in which no letter means more to Markdown than itself."""
    return "".join(f"\\{sign}" if sign in r"\`*_[]<>|~$&#" else sign for sign in " ".join(found.name.split()))


def _counted(found: Analysis) -> list[str]:
    """What was measured, and what not."""
    left_out = found.total - len(found.number)
    words = f"{_number(left_out)} {'is' if left_out == 1 else 'are'} left out" if left_out else "none is left out"
    return [
        f"**{_title(found)}**: {strokes_in(found)} on {found.size[1]} x {found.size[0]} px; {words} "
        f"(fainter than {FAINTEST}, thinner than {shown(thinnest_of(found.total, found.size))} px, or hidden more "
        "than was asked for). "
        f"A pitch is {shown(found.pitch)} px. The neighbourhood reaches {shown(found.measures.radius)} px "
        f"({shown(found.measures.radius / found.pitch)} pitches)."
    ]


def strokes_in(found: Analysis) -> str:
    """How many strokes were measured, in words."""
    return f"{_number(len(found.number))} stroke{'s' * (len(found.number) != 1)}"


def _overall(found: Sequence[Analysis]) -> list[str]:
    rows = [["", *(one.name for one in found)], ["---", *("---:" for _ in found)]]
    numbers = [overall_of(one) for one in found]
    for key, meant in OVERALL.items():
        rows.append([meant.name, *(with_unit(each[key], meant.unit) for each in numbers)])
    return ["## The whole", "", _markdown(rows)]


def _statistics(found: Analysis) -> list[str]:
    """Every measure in pixels, and lengths and areas in pitches too."""
    rows = [["measure", "unit", *(WORDS[name] for name in HEAD)], ["---", "---", *("---:" for _ in HEAD)]]
    for key, measure in MEASURES.items():
        units = [(measure.unit, found.values(key))]
        if measure.power:
            units.append((relative_unit(key), found.relative(key)))
        for unit, values in units:
            numbers = statistics_of(values, measure.axial)
            rows.append([measure.name, unit, *(shown(numbers[name]) for name in HEAD)])
    return [_markdown(rows)]


def _comparison(one: Analysis, other: Analysis) -> list[str]:
    head = ["measure", "unit", one.name, other.name, "difference", "in sd", "Cliff's delta", "effect", "distance"]
    rows = [head, ["---", "---", *("---:" for _ in head[2:7]), "---", "---:"]]
    for key, far in comparison_of(one, other).items():
        measure = MEASURES[key]
        sides = [statistics_of(each.relative(key), measure.axial) for each in (one, other)]
        cells = [" ± ".join([shown(side["mean"]), shown(side["sd"])]) for side in sides]
        numbers = [shown(far[name]) for name in ("difference", "standardised", "delta")]
        rows.append(
            [measure.name, relative_unit(key), *cells, *numbers, str(far["effect"] or MISSING), shown(far["distance"])]
        )
    return [
        "## Side by side", "",
        "Mean ± standard deviation of the strokes, lengths in pitches of each painting; difference: "
        f"{_title(one)} less {_title(other)}.", "",
        _markdown(rows), "",
        "In sd: the difference in pooled standard deviations. Cliff's delta: how much more often a stroke of the first "
        "is larger than one of the second than the other way round, from -1 to 1; in words by the limits of Romano et "
        "al. (2006). Distance: Wasserstein-1, how far strokes must change on average to turn one distribution into the "
        "other. There are no p-values: of thousands of strokes every difference is significant, and strokes of one "
        "painting are no independent samples of a painter. Whether two painters differ, many paintings of each tell.",
    ]  # fmt: skip


def _definitions() -> list[str]:
    lines = ["## What is measured", ""]
    lines += [f"- {measure.name}: {measure.meaning}." for measure in MEASURES.values()]
    lines += [f"- {meant.name} (of the whole): {meant.meaning}." for meant in OVERALL.values()]
    return [
        *lines, "",
        "Directions grow clockwise as they are seen. A pitch is sqrt(area of the canvas / strokes): in pitches, "
        "paintings of different sizes compare. The words are those of Li, Yao, Hendriks and Wang (2012), Rhythmic "
        "brushstrokes distinguish van Gogh from his contemporaries, IEEE TPAMI 34(6), 1159-1176.",
    ]  # fmt: skip


def _markdown(rows: list[list[str]]) -> str:
    """A table from its head, its rules, and rows."""
    head, rules, *cells = rows
    return markdown_table(DataFrame(cells, columns=head), align="".join("lr"[rule.endswith(":")] for rule in rules))


def relative_unit(key: str) -> str:
    """Unit of a measure in which paintings of different sizes compare."""
    return {0: MEASURES[key].unit, 1: "pitches", 2: "pitches^2"}[MEASURES[key].power]


def with_unit(value: float | None, unit: str) -> str:
    """A number and its unit; a share in per cent."""
    if value is None:
        return MISSING
    return f"{shown(100 * value)} %" if unit == "%" else f"{shown(value)}{unit}"


def shown(value: object) -> str:
    """A number with three digits that tell something; a dash for none."""
    if not isinstance(value, int | float) or not np.isfinite(value):
        return MISSING
    return _number(round(value)) if isinstance(value, int) or abs(value) >= 1000 else f"{value:.3g}"


def _number(value: int) -> str:
    return f"{value:,}"
