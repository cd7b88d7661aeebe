"""Write a leaderboard as Markdown, CSV and LaTeX.

The Markdown file has a table for each section. The CSV files contain every metric, the PSNR of every picture, and the
PSNR after equal times.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from brushexp_studies.paired import CONFIDENCE, interval

from brushexp.contracts.files import write_text
from brushexp.contracts.results import MISSING, csv_table, escape_markdown, latex_table, markdown_table
from brushexp_thesis.published import PublishedFigures
from brushexp_thesis.standings import COLUMNS, Section, count_of

TEXT = Path(__file__).with_name("templates") / "leaderboard.md"
EXPLANATION = " ".join(TEXT.read_text(encoding="utf-8").split()).format(confidence=CONFIDENCE)
BEHIND = "behind, dB"
EQUAL_SECONDS = "The best PSNR in dB within the given seconds of optimisation; finished paintings keep their value."
FILES = (
    "[leaderboard.csv](leaderboard.csv) has every metric and command, [pictures.csv](pictures.csv) the PSNR of each "
    "picture, and [seconds.csv](seconds.csv) the PSNR after equal times for runs with curves."
)
IN_TEXT = ("psnr", "ssim", "ms_ssim", "perceptual", "bits", "psnr_decoded", "seconds")  # metrics in the Markdown
THESE = "these"  # name for the pictures of a measured row
PUBLISHED = "Published figures for {}: not measured here, and not in any mean."
ELSEWHERE = "Figures published for other pictures: they are not comparable with anything above."


def write_leaderboard_tables(
    folder: Path, sections: Sequence[Section], elsewhere: Sequence[PublishedFigures], command: str, note: str = ""
) -> Path:
    """Write ``leaderboard.md``, ``.csv`` and ``.tex``, ``pictures.csv`` and ``seconds.csv``; return the first path.

    ``command`` is the command line that produces these files.
    """
    write_text(folder / "leaderboard.md", "\n".join(_markdown(sections, command, note)))
    lines = [line for section in sections for line in _numbers_of(section)]
    lines += [_published_numbers(one, one.of.pictures, "elsewhere") for one in elsewhere]
    write_text(folder / "leaderboard.csv", csv_table(lines))
    for name, rows_of in (("pictures", by_picture), ("seconds", at_equal_seconds)):
        cells = [row | {"in": section.title} for section in sections for row in rows_of(section)]
        if cells:
            write_text(folder / f"{name}.csv", csv_table(cells))
    tables = [f"% {' '.join(one.title.split())}\n{latex_table(without_empty(table_cells(one)))}" for one in sections]
    write_text(folder / "leaderboard.tex", "\n".join(tables))
    return folder / "leaderboard.md"


def table_cells(section: Section) -> list[dict[str, str]]:
    """Return a section's table: first the measured rows, whose ``pictures`` are "these", then the published ones."""
    rows = []
    for row in section.rows:
        means = {metric.name: _mean(row.numbers.get(key, ()), metric.digits) for key, metric in COLUMNS.items()}
        behind = section.against_best(row)
        means[BEHIND] = MISSING if behind is None else _with_interval(behind, 2)
        rows.append(row.words | means | {"pictures": THESE})
    return rows + [published_cells(one, section.relation(one)) for one in section.published]


def published_cells(figures: PublishedFigures, pictures: str) -> dict[str, str]:
    """Return a table row of published figures, with their source in the ``settings`` column."""
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
    """Compute each row's mean PSNR, with its interval, at the section's times; skip rows without curves."""
    rows = [row for row in section.rows if row.curves and section.times]
    return [row.words | {f"{time:g} s": _mean(row.psnr_at(time), 2) for time in section.times} for row in rows]


def by_picture(section: Section) -> list[dict[str, str]]:
    """List the PSNR of each row on each picture, averaged over seeds."""
    return [
        row.words | {"picture": name, "psnr": f"{psnr:.2f}"}
        for row in section.rows
        for name, psnr in zip(section.stems, row.numbers["psnr"], strict=True)
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
        yield _published_numbers(one, section.relation(one), section.title)


def _published_numbers(figures: PublishedFigures, pictures: str, title: str) -> dict[str, Any]:
    line = {"painter": figures.painter, "settings": figures.source, "strokes": figures.primitives, **figures.figures}
    return line | {"from": "published", "pictures": pictures, "in": title}


def _markdown(sections: Sequence[Section], command: str, note: str) -> Iterator[str]:
    yield from ("# Leaderboard", "", *([escape_markdown(note), ""] if note else []), f"Command: `{command}`", "")
    left_out = {metric.name for key, metric in COLUMNS.items() if key not in IN_TEXT}
    for section in sections:
        cells = [{key: text for key, text in row.items() if key not in left_out} for row in table_cells(section)]
        measured = [row for row in without_empty(cells) if row["pictures"] == THESE]
        yield from (f"## {escape_markdown(section.title)}", "", _table(measured), "")
        published = [row for row in cells if row["pictures"] != THESE]
        for pictures in dict.fromkeys(row["pictures"] for row in published):
            yield from (PUBLISHED.format(escape_markdown(pictures)), "")
            yield from (_table(without_empty([row for row in published if row["pictures"] == pictures])), "")
    yield from (FILES, "", "## How to read the tables", "", EXPLANATION, "")


def without_empty(cells: Sequence[Mapping[str, str]]) -> list[dict[str, str]]:
    """Remove the columns in which every cell is empty."""
    empty = {key for key in (cells[0] if cells else ()) if all(row[key] in ("", MISSING) for row in cells)}
    return [{key: text for key, text in row.items() if key not in empty} for row in cells]


def _table(cells: Sequence[Mapping[str, str]]) -> str:
    rows = [{key: text for key, text in row.items() if key != "pictures"} for row in cells]
    sides = "".join("l" if key in ("painter", "settings") else "r" for key in rows[0])
    return markdown_table(rows, align=sides)
