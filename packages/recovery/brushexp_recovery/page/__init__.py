"""The page of recovered strokes: the photograph with zoom, its strokes outlined, figures, exports."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from brushexp.pages.html import embed, page
from brushexp.system.files import write_text
from brushexp_recovery.measure_files import APART, DIRECTIONS, MEANING
from brushexp_recovery.stroke_rows import Rows

TEMPLATES = Path(__file__).parent / "templates"
PAGE_NAME = "strokes.html"
JPEG = {"format": "JPEG", "quality": 92, "subsampling": 0}
WORDS = ("measure", "unit", "apart")  # columns that are no numbers
ABOUT = {
    "catalogue.h5": "the strokes, for the other tasks",
    "strokes.csv": "a line per stroke, with units",
    "measures.csv": "figures with their intervals",
    "measures.tex": "the same for LaTeX (booktabs)",
    "measures.md": "the same for people",
    "measures.json": "the same for programs",
    "measures.pdf": "histograms and rose, vectors",
    "measures.xlsx": "all tables as sheets",
    "differences.csv": "the other painting, and what is apart",
    "differences.tex": "the same for LaTeX",
}


def write_page(
    folder: Path, image: np.ndarray, rows: Rows, name: str, *,
    tables: Mapping[str, Sequence[Mapping[str, Any]]] | None = None, threshold: float = 0.5,
) -> Path:  # fmt: skip
    """Write ``strokes.html`` into a folder, one file that opens from disk, with links to the files there.

    ``image`` (H, W, 3) uint8 is the photograph at its full size, ``tables`` are rows by title, and ``threshold`` is
    the confidence from which on strokes are shown at first.
    """
    write_text(folder / PAGE_NAME, page_of(image, rows, name, tables=tables, threshold=threshold, folder=folder))
    return folder / PAGE_NAME


def page_of(
    image: np.ndarray, rows: Rows, name: str, *, tables: Mapping[str, Sequence[Mapping[str, Any]]] | None = None,
    threshold: float = 0.5, folder: Path | None = None,
) -> str:  # fmt: skip
    """Make the page; without a ``folder`` it links to no files."""
    there = [(file, about) for file, about in ABOUT.items() if folder is not None and (folder / file).is_file()]
    (height, width), mm = rows.size, rows.mm
    lead = f"{len(rows):,} strokes recovered from {width:,} × {height:,} pixels"
    lead += f", {width * mm / 10:.1f} × {height * mm / 10:.1f} cm" if mm else ""
    return page(
        "recovered.html.j2", TEMPLATES, name=name, lead=lead + ". " + DIRECTIONS, width=width, height=height, mm=mm,
        photograph=embed(Image.fromarray(image), max(rows.size), **JPEG)["source"], threshold=threshold,
        data=data_of(rows, name), words=WORDS, directions=DIRECTIONS, meaning=MEANING, apart=APART, files=there,
        tables=[(title, [_raised(row) for row in table]) for title, table in (tables or {}).items() if table],
    )  # fmt: skip


def data_of(rows: Rows, name: str) -> dict[str, Any]:
    """Collect what the scripts of the page need: columns, outlines and colours of the strokes, bottom to top."""
    return {
        "name": name,
        "width": rows.size[1],
        "height": rows.size[0],
        "mm": rows.mm,
        "names": list(rows.columns),  # in their order, which JSON in a template has not
        "columns": {key: [float(f"{value:.5g}") for value in column] for key, column in rows.columns.items()},
        "outlines": [outline.round(1).tolist() for outline in rows.outlines],
        "colors": ["#" + bytes((255 * color).round().astype(np.uint8)).hex() for color in rows.color.clip(0, 1)],
    }


def _raised(row: Mapping[str, Any]) -> dict[str, Any]:
    """Write mm^2 as mm²."""
    return {key: value.replace("^2", "²") if key == "unit" else value for key, value in row.items()}
