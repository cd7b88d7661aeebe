"""Write a leaderboard as Markdown, CSV and LaTeX."""

import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from brushexp_studies.paired import CONFIDENCE, interval

from brushexp.contracts.files import write_text
from brushexp.contracts.results import MISSING, csv_table, escape_markdown, latex_table, make_unique, markdown_table
from brushexp_thesis.published import PublishedFigures
from brushexp_thesis.standings import COLUMNS, Section, count_of

TEXT = Path(__file__).with_name("templates") / "leaderboard.md"
EXPLANATION = " ".join(TEXT.read_text(encoding="utf-8").split()).format(confidence=CONFIDENCE)
BEHIND = "behind, dB"
EQUAL_SECONDS = "The best PSNR in dB within so many seconds of optimisation; a painting that is done stays."
ELSEWHERE = "Figures that others have published, of pictures that are not here: they compare with nothing above."


def write_leaderboard_tables(
    folder: Path, sections: Sequence[Section], elsewhere: Sequence[PublishedFigures], command: str, note: str = ""
) -> Path:
    """Write ``leaderboard.md``, ``.csv`` and ``.tex``, and return the first; ``command`` is what has made them."""
    write_text(folder / "leaderboard.md", "\n".join(_markdown(sections, elsewhere, command, note)))
    write_text(folder / "leaderboard.csv", csv_table([line for section in sections for line in _numbers_of(section)]))
    tables = [f"% {' '.join(one.title.split())}\n{latex_table(without_empty(table_cells(one)))}" for one in sections]
    write_text(folder / "leaderboard.tex", "\n".join(tables))
    return folder / "leaderboard.md"


def table_cells(section: Section) -> list[dict[str, str]]:
    """Make the table of a section: measured rows, then published ones, whose ``pictures`` are not "these"."""
    rows = []
    for row in section.rows:
        means = {metric.name: _mean(row.numbers.get(key, ()), metric.digits) for key, metric in COLUMNS.items()}
        behind = section.against_best(row)
        means[BEHIND] = MISSING if behind is None else _with_interval(behind, 2)
        rows.append(row.words | means | {"pictures": "these"})
    return rows + [published_cells(one, section.relation(one)) for one in section.published]


def published_cells(figures: PublishedFigures, pictures: str) -> dict[str, str]:
    """Make a row of published figures; its settings are the source."""
    size = " at {} x {}".format(*figures.of.size) if len(figures.of.size) == 2 else ""
    machine = f", on {figures.machine}" if figures.machine else ""
    strokes = f"{count_of(figures.primitives)} {figures.what}" if figures.primitives else MISSING
    values = {m.name: f"{figures.figures[key]:g}" if key in figures.figures else MISSING for key, m in COLUMNS.items()}
    words = {"painter": figures.painter, "settings": figures.source + machine, "strokes": strokes}
    return words | values | {BEHIND: MISSING, "pictures": pictures + size}


def _mean(values: Sequence[float] | np.ndarray, digits: int) -> str:
    return _with_interval(interval(values), digits) if len(values) else MISSING


def _with_interval(bounds: tuple[float, float, float], digits: int) -> str:
    mean, _, high = bounds
    return f"{mean:.{digits}f}" + (f" ± {high - mean:.{digits}f}" if math.isfinite(high) else "")


def at_equal_seconds(section: Section) -> list[dict[str, str]]:
    """Compute the mean PSNR of each row with curves after so many seconds, with its interval."""
    rows = [row for row in section.rows if row.curves and section.times]
    return [row.words | {f"{time:g} s": _mean(row.psnr_at(time), 2) for time in section.times} for row in rows]


def by_picture(section: Section) -> list[dict[str, str]]:
    """List the PSNR of each picture, means over seeds; empty for one picture, and for more than 24."""
    names = make_unique([*section.rows[0].words, *section.stems])[3:]
    if not 1 < len(names) <= 24:
        return []
    return [
        row.words | {name: f"{psnr:.2f}" for name, psnr in zip(names, row.numbers["psnr"], strict=True)}
        for row in section.rows
    ]


def _numbers_of(section: Section) -> Iterator[dict[str, Any]]:
    pictures = ", ".join(section.pictures.values())
    for row in section.rows:
        line: dict[str, Any] = {"painter": row.painter, "settings": row.settings, "strokes": row.strokes}
        for key, values in row.numbers.items():
            line[key], line[f"{key}_low"], line[f"{key}_high"] = interval(values)
        line |= {"from": "measured", "pictures": pictures, "command": row.entries[0].command}
        yield line | {"in": section.title}
    for one in section.published:
        line = {"painter": one.painter, "settings": one.source, "strokes": one.primitives, **one.figures}
        yield line | {"from": "published", "pictures": section.relation(one), "in": section.title}


def _markdown(
    sections: Sequence[Section], elsewhere: Sequence[PublishedFigures], command: str, note: str
) -> Iterator[str]:
    yield from ("# Leaderboard", "", f"Made by `{command}`.", "")
    yield from (*([escape_markdown(note), ""] if note else []), EXPLANATION, "")
    for section in sections:
        yield from (f"## {escape_markdown(section.title)}", "", _table(table_cells(section)), "")
        tables = {EQUAL_SECONDS: at_equal_seconds(section), "PSNR in dB by picture.": by_picture(section)}
        for words, cells in tables.items():
            if cells:
                yield from (words, "", _table(cells), "")
        commands = [f"    {row.entries[0].command}" for row in section.rows if row.entries[0].command]
        if commands:
            yield from ("The first picture of each row:", "", *commands, "")
    if elsewhere:
        cells = [published_cells(one, one.of.pictures) for one in elsewhere]
        yield from ("## Published elsewhere", "", ELSEWHERE, "", _table(cells), "")


def without_empty(cells: Sequence[Mapping[str, str]]) -> list[dict[str, str]]:
    """Remove the columns in which every cell is empty."""
    empty = {key for key in (cells[0] if cells else ()) if all(row[key] in ("", MISSING) for row in cells)}
    return [{key: text for key, text in row.items() if key not in empty} for row in cells]


def _table(cells: Sequence[Mapping[str, str]]) -> str:
    rows = []
    for row in without_empty(cells):
        italic = "*" * (row.get("pictures", "these") != "these")
        rows.append({key: f"{italic}{escape_markdown(text)}{italic}" if text else "" for key, text in row.items()})
    sides = "".join("l" if key in ("painter", "settings", "pictures") else "r" for key in rows[0])
    return markdown_table(rows, align=sides, escape=False)
