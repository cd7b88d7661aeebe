"""A leaderboard as Markdown, CSV and LaTeX."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from brushexp.reporting.tables import MISSING, csv_table, escaped, latex_table, markdown_table
from brushexp.results.paired import CONFIDENCE, interval
from brushexp.results.quantities import quantities
from brushexp.results.runs import told_apart
from brushexp.system.files import write_text
from brushexp_thesis.published import PublishedFigures
from brushexp_thesis.standings import COLUMNS, Row, Section, stem_of

MOST_PICTURES = 24  # with a column each
EXPLAINED = (
    f"Means over the pictures of a section ± half of the {CONFIDENCE:.0%} interval (Student's t); with several seeds, "
    "over those first. *Behind* is the mean difference in PSNR, picture by picture, from the best row with as many "
    "strokes; an interval that does not reach 0 is a difference. Seconds, of the wall and of the CPU, are of the "
    "optimisation, memory is of the process, on the machine that painted. *Rows in italics are published figures*: "
    "they were not measured here, enter no mean, and are of the pictures that their row names."
)
ELSEWHERE = "Figures that others have published, of pictures that are not here: they compare with nothing above."


def write_leaderboard_tables(
    folder: Path, sections: Sequence[Section], elsewhere: Sequence[PublishedFigures], command: str, note: str = ""
) -> Path:
    """Write ``leaderboard.md``, ``.csv`` and ``.tex``, and return the first; ``command`` is what has made them."""
    write_text(folder / "leaderboard.md", "\n".join(_markdown(sections, elsewhere, command, note)))
    lines = [line | {"in": section.title} for section in sections for line in _numbers_of(section)]
    write_text(folder / "leaderboard.csv", csv_table(lines))
    tables = (latex_table(without_empty(table_cells(section))) for section in sections)
    titles = ("% " + " ".join(section.title.split()) for section in sections)
    text = "\n".join(f"{title}\n{table}" for title, table in zip(titles, tables, strict=True))
    write_text(folder / "leaderboard.tex", text)
    return folder / "leaderboard.md"


def table_cells(section: Section) -> list[dict[str, str]]:
    """The table of a section as it is shown: measured rows, then published ones, whose ``pictures`` are not "these"."""
    return [_measured(row, section) for row in section.rows] + [
        published_cells(one, section.relation(one)) for one in section.published
    ]


def _measured(row: Row, section: Section) -> dict[str, str]:
    behind = section.against_best(row)
    found = {"painter": row.painter, "settings": row.settings, "strokes": count_of(row.strokes)}
    for key, metric in COLUMNS.items():
        found[metric.name] = (
            _with_interval(interval(row.numbers[key]), metric.digits) if key in row.numbers else MISSING
        )
    found["behind, dB"] = MISSING if behind is None else _with_interval(behind, 2)
    return found | {"pictures": "these"}


def published_cells(figures: PublishedFigures, pictures: str) -> dict[str, str]:
    """A row of published figures; its settings are the source."""
    size = " at {} x {}".format(*figures.size) if len(figures.size) == 2 else ""
    machine = f", on {figures.machine}" if figures.machine else ""
    strokes = f"{count_of(figures.primitives)} {figures.what}" if figures.primitives else MISSING
    found = {"painter": figures.painter, "settings": figures.source + machine, "strokes": strokes}
    for key, metric in COLUMNS.items():
        found[metric.name] = f"{figures.figures[key]:g}" if key in figures.figures else MISSING
    return found | {"behind, dB": MISSING, "pictures": pictures + size}


def count_of(strokes: float | None) -> str:
    """A number of strokes."""
    return MISSING if strokes is None else f"{strokes:,.0f}"


def _with_interval(found: tuple[float, float, float], digits: int) -> str:
    mean, _, high = found
    return f"{mean:.{digits}f}" + (f" ± {high - mean:.{digits}f}" if math.isfinite(high) else "")


def at_equal_seconds(section: Section) -> list[dict[str, str]]:
    """Mean PSNR of each row with curves after so many seconds, and its interval; none if no two can be compared."""
    return [
        {"painter": row.painter, "settings": row.settings, "strokes": count_of(row.strokes)}
        | {
            f"{time:g} s": _with_interval(interval(psnr), quantities()["psnr"].digits)
            if (psnr := row.psnr_at(time))
            else MISSING
            for time in section.times
        }
        for row in section.rows
        if row.curves and section.times
    ]


def by_picture(section: Section) -> list[dict[str, str]]:
    """PSNR of each picture, means over seeds; nothing for one picture, or too many."""
    names = told_apart(["painter", "settings", "strokes", *map(stem_of, section.pictures.values())])[3:]
    if not 1 < len(names) <= MOST_PICTURES:
        return []
    return [
        {"painter": row.painter, "settings": row.settings, "strokes": count_of(row.strokes)}
        | {name: f"{psnr:.2f}" for name, psnr in zip(names, row.numbers["psnr"], strict=True)}
        for row in section.rows
    ]


def _numbers_of(section: Section) -> Iterator[dict[str, Any]]:
    """The rows of a section in full precision."""
    for row in section.rows:
        found: dict[str, Any] = {"painter": row.painter, "settings": row.settings, "strokes": row.strokes}
        for key, values in row.numbers.items():
            found[key], found[f"{key}_low"], found[f"{key}_high"] = interval(values)
        pictures = ", ".join(section.pictures.values())
        yield found | {"from": "measured", "pictures": pictures, "command": row.entries[0].command}
    for one in section.published:
        found = {"painter": one.painter, "settings": one.source, "strokes": one.primitives, **one.figures}
        yield found | {"from": "published", "pictures": section.relation(one)}


def _markdown(
    sections: Sequence[Section], elsewhere: Sequence[PublishedFigures], command: str, note: str
) -> Iterator[str]:
    yield from ("# Leaderboard", "", f"Made by `{command}`.", "", *([escaped(note), ""] if note else []), EXPLAINED, "")
    for section in sections:
        yield from (f"## {escaped(section.title)}", "", _table(table_cells(section)), "")
        for words, found in (
            (
                "The best PSNR in dB within so many seconds of optimisation; a painting that is done stays.",
                at_equal_seconds(section),
            ),
            ("PSNR in dB by picture.", by_picture(section)),
        ):
            if found:
                yield from (words, "", _table(found), "")
        yield from _commands(section)
    if elsewhere:
        cells = [published_cells(one, one.pictures) for one in elsewhere]
        yield from ("## Published elsewhere", "", ELSEWHERE, "", _table(cells), "")


def without_empty(cells: Sequence[Mapping[str, str]]) -> list[dict[str, str]]:
    """The rows without columns in which nothing stands."""
    empty = {key for key in (cells[0] if cells else ()) if all(row[key] in ("", MISSING) for row in cells)}
    return [{key: text for key, text in row.items() if key not in empty} for row in cells]


def _table(cells: Sequence[Mapping[str, str]]) -> str:
    """A table; published rows in italics."""
    rows = []
    for row in without_empty(cells):
        italic = "*" * (row.get("pictures", "these") != "these")
        rows.append({key: f"{italic}{escaped(text)}{italic}" if text else "" for key, text in row.items()})
    sides = "".join("l" if key in ("painter", "settings", "pictures") else "r" for key in rows[0])
    return markdown_table(rows, align=sides, escape=False)


def _commands(section: Section) -> Iterator[str]:
    """What repeats the first picture of each row."""
    lines = [f"    {row.entries[0].command}" for row in section.rows if row.entries[0].command]
    if lines:
        yield from ("The first picture of each row:", "", *lines, "")
