"""Write the results of an analysis as a CSV table of strokes and as summaries in JSON and Markdown."""

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from brushexp.contracts.files import write_json, write_text
from brushexp.contracts.results import MEASURES, MISSING, SIZE_MEASURES, csv_table, escape_markdown, markdown_table
from brushexp.contracts.strokes import MIN_OPACITY, Measure
from brushexp_studies.analysis.summary import (
    OVERALL,
    STATISTICS,
    Analysis,
    comparison_of,
    in_units,
    overall_of,
    statistics_of,
    summary_of,
    thinnest_of,
)

DIFFERENCES = {"difference": "difference", "in sd": "standardised", "Cliff's delta": "delta"}


def write_summary(folder: Path, analyses: Sequence[Analysis]) -> list[Path]:
    """Write ``brushwork.csv``, ``summary.json`` and ``summary.md`` for one painting, or for two side by side."""
    names = ["brushwork.csv", "brushwork_against.csv"][: len(analyses)]
    for one, name in zip(analyses, names, strict=True):
        write_text(folder / name, strokes_csv(one))
    data = summary_of(analyses[0])
    if len(analyses) > 1:
        data |= {"against": summary_of(analyses[1]), "comparison": comparison_of(*analyses)}
    write_json(folder / "summary.json", data)
    write_text(folder / "summary.md", brushwork_text(analyses))
    return [folder / name for name in (*names, "summary.json", "summary.md")]


def strokes_csv(analysis: Analysis) -> str:
    """Return a CSV table with one row per measured stroke, in the catalogue's order; undefined values are empty.

    The last column names the setting, if any, that fixed the strokes' length, width, area and elongatedness.
    """
    columns: dict[str, Any] = {"stroke": analysis.number, "depth": analysis.depth}
    for key in analysis.measures.dtype.names or ():
        measure = MEASURES.get(key, Measure(key, "place", unit="px"))
        unit = f" [{measure.unit}]".replace("°", "deg") * bool(measure.unit)
        columns[key + unit] = in_units(analysis.measures[key], measure)
    columns["sizes_set_by"] = analysis.sizes_by
    return csv_table(columns, significant=6)


def brushwork_text(analyses: Sequence[Analysis]) -> str:
    """Return all statistics and the definitions of the measures as Markdown."""
    lines = [f"# Brushwork of {' and '.join(escape_markdown(one.name) for one in analyses)}", ""]
    lines += [line for one in analyses for line in (_heading(one), "")]
    lines += [line for one in analyses for line in (sizes_warning(one), "") if one.sizes_by]
    overall = {"": [measure.name for measure in OVERALL.values()]} | {one.name: overall_texts(one) for one in analyses}
    lines += ["## The whole", "", markdown_table(overall, align="l" + "r" * len(analyses)), ""]
    if len(analyses) > 1:
        lines += [*_comparison(analyses[0], analyses[1]), ""]
    for one in analyses:
        lines += [f"## Strokes of {escape_markdown(one.name)}", "", _statistics(one), ""]
    return "\n".join([*lines, *_definitions(), ""])


def _heading(analysis: Analysis) -> str:
    return (
        f"**{escape_markdown(analysis.name)}**: {strokes_in(analysis)} on {analysis.size[1]} x {analysis.size[0]} px; "
        f"{analysis.total - len(analysis.number):,} left out (fainter than {MIN_OPACITY}, thinner than "
        f"{three_digits(thinnest_of(analysis.total, analysis.size))} px, or hidden more than allowed). "
        f"A pitch is {three_digits(analysis.pitch)} px; neighbours are within {three_digits(analysis.radius)} px."
    )


def sizes_warning(analysis: Analysis) -> str:
    """Warn that the stroke sizes were fixed by a setting and therefore say nothing about the picture."""
    name = escape_markdown(analysis.name)
    return (
        f"**Length, width, area and elongatedness of {name} are set by `{analysis.sizes_by}`** and say "
        "nothing about the painter's brushes. Nor do layers and homogeneity of breadth, which follow from them. "
        "Directions and coherence come from the picture."
    )


def setters_of(key: str, analyses: Sequence[Analysis]) -> str:
    """Name the settings that fixed a measure regardless of the picture; return "" if there are none."""
    return ", ".join(dict.fromkeys(one.sizes_by for one in analyses if one.sizes_by and key in SIZE_MEASURES))


def name_with_setters(key: str, analyses: Sequence[Analysis]) -> str:
    """Return the name of a measure, followed by the settings, if any, that fixed it regardless of the picture."""
    setters = setters_of(key, analyses)
    return MEASURES[key].name + f" (set by {setters})" * bool(setters)


def strokes_in(analysis: Analysis) -> str:
    """Format the number of measured strokes, for example as "12 strokes"."""
    return f"{len(analysis.number):,} stroke{'s' * (len(analysis.number) != 1)}"


def _statistics(analysis: Analysis) -> str:
    """Tabulate every measure in its own unit; lengths and areas are also given in pitches."""
    rows = []
    for key, measure in MEASURES.items():
        for unit, values in {measure.unit: analysis.values(key), relative_unit(key): analysis.relative(key)}.items():
            texts = {STATISTICS[name]: three_digits(x) for name, x in statistics_of(values, measure.axial).items()}
            rows.append({"measure": name_with_setters(key, [analysis]), "unit": unit} | texts)
    return markdown_table(rows, align="ll" + "r" * len(STATISTICS))


def _comparison(one: Analysis, other: Analysis) -> list[str]:
    rows = []
    for key, far in comparison_of(one, other).items():
        row = {"measure": name_with_setters(key, [one, other]), "unit": relative_unit(key)}
        for each in (one, other):
            side = statistics_of(each.relative(key), MEASURES[key].axial)
            row[each.name] = f"{three_digits(side['mean'])} ± {three_digits(side['sd'])}"
        row |= {head: three_digits(far[name]) for head, name in DIFFERENCES.items()}
        rows.append(row | {"effect": str(far["effect"] or MISSING), "distance": three_digits(far["distance"])})
    return [
        "## Side by side", "",
        "Mean ± standard deviation of the strokes, lengths in pitches of each painting; difference: "
        f"{escape_markdown(one.name)} minus {escape_markdown(other.name)}.", "",
        markdown_table(rows, align="llrrrrrlr"), "",
        "In sd: the difference in pooled standard deviations. Cliff's delta: the probability that a stroke of the "
        "first is larger than a stroke of the second, minus the reverse, from -1 to 1, in words by the thresholds of "
        "Romano et al. (2006). Distance: Wasserstein-1. There are no p-values, because with thousands of strokes every "
        "difference is significant, and strokes of one painting are not independent samples of a painter.",
    ]  # fmt: skip


def _definitions() -> list[str]:
    measures = [*MEASURES.values(), *OVERALL.values()]
    return [
        "## What is measured", "",
        *(f"- {one.name}: {one.meaning}{f' ({one.source})' * bool(one.source)}." for one in measures), "",
        "Directions run clockwise from horizontal: 45° falls to the right. A pitch is sqrt(area of the canvas / "
        "strokes); lengths in pitches make paintings of different sizes comparable. Most measures are from Li, "
        "Yao, Hendriks and Wang (2012), Rhythmic brushstrokes distinguish van Gogh from his contemporaries, IEEE TPAMI "
        "34(6), 1159-1176.",
    ]  # fmt: skip


def relative_unit(key: str) -> str:
    """Return the unit in which a measure is compared between paintings of different sizes."""
    return {0: MEASURES[key].unit, 1: "pitches", 2: "pitches^2"}[MEASURES[key].power]


def overall_texts(analysis: Analysis, keys: Iterable[str] = OVERALL) -> list[str]:
    """Format the statistics of `overall_of` with their units; fractions are given in per cent."""
    numbers = overall_of(analysis)
    texts = {key: three_digits(x if x is None or OVERALL[key].unit != "%" else 100 * x) for key, x in numbers.items()}
    return [texts[key] + OVERALL[key].unit.replace("%", " %") * (numbers[key] is not None) for key in keys]


def three_digits(value: object) -> str:
    """Format a number with three significant digits, or as a dash if it is missing or not finite."""
    if not isinstance(value, int | float) or not np.isfinite(value):
        return MISSING
    return f"{round(value):,}" if isinstance(value, int) or abs(value) >= 1000 else f"{value:.3g}"
