"""Write measurements to CSV, XLSX, JSON, Markdown, LaTeX and PDF files."""

import io
import logging
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from brushexp.contracts.files import write_bytes, write_json, write_text
from brushexp.contracts.results import csv_table, latex_table, markdown_table
from brushexp_recovery.measure.drawings import write_drawings
from brushexp_recovery.measure.figure_tables import (
    DIRECTIONS,
    MEANING,
    Figures,
    difference_rows,
    figure_rows,
    plain_data,
)
from brushexp_recovery.measure.intervals import Interval
from brushexp_recovery.measure.stroke_table import StrokeTable, columns_with_units

log = logging.getLogger(__name__)


def write_measures(
    folder: Path,
    strokes: StrokeTable,
    figures: Figures,
    differences: Mapping[str, Interval] | None,
    both_mm: float | None,
) -> list[Path]:
    """Write all tables and drawings, and return their paths; differences are in millimetres if ``both_mm`` is set."""
    tables = {"measures": figure_rows(figures, strokes.mm)}
    if differences is not None:
        tables["differences"] = difference_rows(differences, both_mm)
    columns = columns_with_units(strokes)
    write_text(folder / "strokes.csv", csv_table(columns, significant=6))
    paths = [folder / "strokes.csv"]
    text = [f"{MEANING} {DIRECTIONS}"]
    for name, table in tables.items():
        write_text(folder / f"{name}.csv", csv_table(table))
        write_text(folder / f"{name}.tex", latex_table(table))
        text += [f"## {name.capitalize()}", markdown_table(table)]
        paths += [folder / f"{name}.csv", folder / f"{name}.tex"]
    write_text(folder / "measures.md", "\n\n".join(text) + "\n")
    write_json(folder / "measures.json", plain_data(figures, differences, strokes.mm))
    write_drawings(folder / "measures.pdf", strokes)
    paths += [folder / f"measures.{suffix}" for suffix in ("md", "json", "pdf")]
    return paths + _write_sheets(folder, columns, tables)


def _write_sheets(folder: Path, strokes: Mapping[str, Any], tables: Mapping[str, Any]) -> list[Path]:
    """Write all tables as sheets of one workbook if openpyxl is installed."""
    import pandas as pd  # noqa: PLC0415  (slow to import)

    memory = io.BytesIO()
    try:
        with pd.ExcelWriter(memory, engine="openpyxl") as book:
            for name, table in tables.items():
                numbers = [{key: _number_or_text(value) for key, value in row.items()} for row in table]
                pd.DataFrame(numbers).to_excel(book, sheet_name=name, index=False)
            pd.DataFrame(strokes).to_excel(book, sheet_name="strokes", index=False)
    except ImportError:
        log.warning("no measures.xlsx: openpyxl is missing, pip install 'brushexp[xlsx]'")
        return []
    write_bytes(folder / "measures.xlsx", memory.getvalue())
    return [folder / "measures.xlsx"]


def _number_or_text(value: Any) -> Any:
    """Convert text to a number if possible, so that spreadsheets can calculate with it."""
    try:
        return float(value)
    except (TypeError, ValueError):
        return value
