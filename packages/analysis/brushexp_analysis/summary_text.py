"""What was measured, as files: a row per stroke, a summary for programs, and one for people."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from brushexp.reporting.tables import MISSING, csv_table, escaped, markdown_table
from brushexp.results.stroke_table import MEASURES
from brushexp.strokes.brushwork import MIN_OPACITY
from brushexp.strokes.measures import Measure
from brushexp.system.files import write_json, write_text
from brushexp_analysis.samples import statistics_of
from brushexp_analysis.summary import OVERALL, Analysis, comparison_of, in_units, overall_of, summary_of, thinnest_of

HEADINGS = {"n": "n", "mean": "mean", "sd": "standard deviation", "q25": "25 %", "median": "median", "q75": "75 %"}
DIFFERENCES = {"difference": "difference", "in sd": "standardised", "Cliff's delta": "delta"}


def write_summary(folder: Path, analyses: Sequence[Analysis]) -> list[Path]:
    """Write ``brushwork.csv``, ``summary.json`` and ``summary.md`` of one painting, or of two side by side."""
    paths = []
    for one, name in zip(analyses, ("brushwork.csv", "brushwork_against.csv"), strict=False):
        paths.append(folder / name)
        write_text(paths[-1], strokes_csv(one))
    data = summary_of(analyses[0])
    if len(analyses) > 1:
        data |= {"against": summary_of(analyses[1]), "comparison": comparison_of(*analyses)}
    write_json(folder / "summary.json", data)
    write_text(folder / "summary.md", brushwork_text(analyses))
    return [*paths, folder / "summary.json", folder / "summary.md"]


def strokes_csv(analysis: Analysis) -> str:
    """A row per stroke that counts, in the order of the catalogue; what is not defined is empty."""
    columns: dict[str, Any] = {"stroke": analysis.number, "depth": analysis.depth}
    for key in analysis.measures.dtype.names or ():
        measure = MEASURES.get(key, Measure(key, "place", unit="px"))
        unit = f" [{measure.unit}]".replace("°", "deg") * bool(measure.unit)
        columns[key + unit] = in_units(analysis.measures[key], measure)
    return csv_table(columns, significant=6)


def brushwork_text(analyses: Sequence[Analysis]) -> str:
    """Markdown with all statistics and definitions."""
    lines = [f"# Brushwork of {' and '.join(escaped(one.name) for one in analyses)}", ""]
    overall: dict[str, list[str]] = {"": [meant.name for meant in OVERALL.values()]}
    for one in analyses:
        lines += [_counted(one), ""]
        numbers = overall_of(one)
        overall[one.name] = [with_unit(numbers[key], meant.unit) for key, meant in OVERALL.items()]
    lines += ["## The whole", "", markdown_table(overall, align="l" + "r" * len(analyses)), ""]
    if len(analyses) > 1:
        lines += [*_comparison(analyses[0], analyses[1]), ""]
    for one in analyses:
        lines += [f"## Strokes of {escaped(one.name)}", "", _statistics(one), ""]
    return "\n".join([*lines, *_definitions(), ""])


def _counted(analysis: Analysis) -> str:
    return (
        f"**{escaped(analysis.name)}**: {strokes_in(analysis)} on {analysis.size[1]} x {analysis.size[0]} px; "
        f"{analysis.total - len(analysis.number):,} left out (fainter than {MIN_OPACITY}, thinner than "
        f"{three_digits(thinnest_of(analysis.total, analysis.size))} px, or hidden more than was asked for). "
        f"A pitch is {three_digits(analysis.pitch)} px. Neighbours are counted within "
        f"{three_digits(analysis.radius)} px ({three_digits(analysis.radius / analysis.pitch)} pitches)."
    )


def strokes_in(analysis: Analysis) -> str:
    """How many strokes were measured, in words."""
    return f"{len(analysis.number):,} stroke{'s' * (len(analysis.number) != 1)}"


def _statistics(analysis: Analysis) -> str:
    """Every measure in pixels, and lengths and areas in pitches too."""
    rows = []
    for key, measure in MEASURES.items():
        # Both are the same unless it is a length or an area.
        for unit, values in {measure.unit: analysis.values(key), relative_unit(key): analysis.relative(key)}.items():
            shown = {HEADINGS[name]: three_digits(x) for name, x in statistics_of(values, measure.axial).items()}
            rows.append({"measure": measure.name, "unit": unit} | shown)
    return markdown_table(rows, align="ll" + "r" * len(HEADINGS))


def _comparison(one: Analysis, other: Analysis) -> list[str]:
    rows = []
    for key, far in comparison_of(one, other).items():
        measure = MEASURES[key]
        row = {"measure": measure.name, "unit": relative_unit(key)}
        for each in (one, other):
            side = statistics_of(each.relative(key), measure.axial)
            row[each.name] = f"{three_digits(side['mean'])} ± {three_digits(side['sd'])}"
        row |= {head: three_digits(far[name]) for head, name in DIFFERENCES.items()}
        rows.append(row | {"effect": str(far["effect"] or MISSING), "distance": three_digits(far["distance"])})
    return [
        "## Side by side", "",
        "Mean ± standard deviation of the strokes, lengths in pitches of each painting; difference: "
        f"{escaped(one.name)} less {escaped(other.name)}.", "",
        markdown_table(rows, align="llrrrrrlr"), "",
        "In sd: the difference in pooled standard deviations. Cliff's delta: how much more often a stroke of the first "
        "is larger than one of the second than the other way round, from -1 to 1; in words by the limits of Romano et "
        "al. (2006). Distance: Wasserstein-1, how far strokes must change on average to turn one distribution into the "
        "other. There are no p-values: of thousands of strokes every difference is significant, and strokes of one "
        "painting are no independent samples of a painter. Whether two painters differ, many paintings of each tell.",
    ]  # fmt: skip


def _definitions() -> list[str]:
    meant = [*MEASURES.values(), *OVERALL.values()]
    return [
        "## What is measured", "",
        *(f"- {one.name}: {one.meaning}{f' ({one.source})' * bool(one.source)}." for one in meant), "",
        "Directions grow clockwise as they are seen. A pitch is sqrt(area of the canvas / strokes): in pitches, "
        "paintings of different sizes compare. Most measures are those of Li, Yao, Hendriks and Wang (2012), Rhythmic "
        "brushstrokes distinguish van Gogh from his contemporaries, IEEE TPAMI 34(6), 1159-1176.",
    ]  # fmt: skip


def relative_unit(key: str) -> str:
    """Unit of a measure in which paintings of different sizes compare."""
    return {0: MEASURES[key].unit, 1: "pitches", 2: "pitches^2"}[MEASURES[key].power]


def with_unit(value: float | None, unit: str) -> str:
    """A number and its unit; a share in per cent."""
    if value is None:
        return MISSING
    return f"{three_digits(100 * value)} %" if unit == "%" else f"{three_digits(value)}{unit}"


def three_digits(value: object) -> str:
    """A number with three digits that tell something; a dash for none."""
    if not isinstance(value, int | float) or not np.isfinite(value):
        return MISSING
    return f"{round(value):,}" if isinstance(value, int) or abs(value) >= 1000 else f"{value:.3g}"
