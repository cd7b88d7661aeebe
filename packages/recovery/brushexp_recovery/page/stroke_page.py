"""Write the page of recovered strokes: a zoomable photograph with stroke outlines, measures and exports."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from brushexp.contracts.files import write_text
from brushexp.contracts.pages import embed, page
from brushexp_recovery.measure.figure_tables import APART, DIRECTIONS, MEANING
from brushexp_recovery.measure.stroke_table import (
    StrokeTable,
    covered_share,
    describe_rest,
    doubt_of_paint,
)

TEMPLATES = Path(__file__).parent / "templates"
PAGE_NAME = "strokes.html"
JPEG = {"format": "JPEG", "quality": 92, "subsampling": 0}
SHOWN = 0.5  # minimum confidence of the strokes shown at first, and least share of the strokes that are shown
THRESHOLD_STEPS = 20  # steps of this confidence from 0 to 1
TEXT_COLUMNS = ("measure", "unit", "apart")
FILES = {
    "catalogue.h5": "the strokes, for other tasks",
    "strokes.csv": "a line per stroke, with units",
    "order.graphml": "the order of strokes that meet, with probabilities",
    "measures.csv": "figures with their intervals",
    "measures.tex": "the same for LaTeX (booktabs)",
    "measures.md": "the same for reading",
    "measures.json": "the same for programs",
    "measures.pdf": "histograms and a rose diagram, as vectors",
    "measures.xlsx": "all tables as sheets",
    "differences.csv": "differences from the other painting",
    "differences.tex": "the same for LaTeX",
}
Tables = Mapping[str, Sequence[Mapping[str, Any]]]  # rows by title


def write_page(
    folder: Path,
    image: np.ndarray,
    strokes: StrokeTable,
    name: str,
    *,
    tables: Tables | None = None,
    threshold: float | None = None,
) -> Path:
    """Write ``strokes.html`` into a folder, as a self-contained page with links to the other files there.

    ``image`` (H, W, 3) uint8 is the photograph at full size. ``threshold`` is the minimum confidence of the strokes
    that are shown initially; if it is None, `initial_threshold` determines it.
    """
    html = page_of(image, strokes, name, tables=tables, threshold=threshold, folder=folder)
    write_text(folder / PAGE_NAME, html)
    return folder / PAGE_NAME


def page_of(
    image: np.ndarray,
    strokes: StrokeTable,
    name: str,
    *,
    tables: Tables | None = None,
    threshold: float | None = None,
    folder: Path | None = None,
) -> str:
    """Return the HTML of the page; without a ``folder``, it contains no links to files."""
    height, width = strokes.size
    mm = strokes.mm
    threshold = initial_threshold(strokes.columns["confidence"]) if threshold is None else threshold
    lead = f"{len(strokes):,} strokes recovered from {width:,} × {height:,} pixels"
    covered = f"They cover {100 * covered_share(strokes):.0f} % of the surface"
    read = f"{covered}, and the figures describe only that part; {describe_rest(strokes)}."
    if (doubt := doubt_of_paint(strokes)) is not None:
        read = f"{doubt[0].upper()}{doubt[1:]}. {read}"
    lead += f", {width * mm / 10:.1f} × {height * mm / 10:.1f} cm" if mm else ""
    files = [(file, about) for file, about in FILES.items() if folder is not None and (folder / file).is_file()]
    raised = [(title, [_raise_squares(row) for row in table]) for title, table in (tables or {}).items() if table]
    return page(
        "recovered.html.j2",
        TEMPLATES,
        name=name,
        lead=f"{lead}. {read} {DIRECTIONS}",
        width=width,
        height=height,
        mm=mm,
        photograph=embed(Image.fromarray(image), max(strokes.size), **JPEG)["source"],
        threshold=threshold,
        mark_width=round(float(np.median(strokes.columns["width"]))) if len(strokes) else 20,
        data=data_of(strokes, name),
        words=TEXT_COLUMNS,
        directions=DIRECTIONS,
        meaning=MEANING,
        apart=APART,
        files=files,
        tables=raised,
    )


def initial_threshold(confidence: np.ndarray) -> float:
    """Return the minimum confidence of the strokes shown at first: 0.5, or lower if needed to show half of the strokes.

    On photographs of real paintings, most confidences are below 0.5.

    >>> initial_threshold(np.array([0.9, 0.8, 0.3]))
    0.5
    >>> initial_threshold(np.array([0.12, 0.28, 0.55]))
    0.25
    """
    if not len(confidence):
        return SHOWN
    rounded = np.floor(THRESHOLD_STEPS * np.quantile(confidence, 1 - SHOWN)) / THRESHOLD_STEPS
    return float(min(SHOWN, rounded))


def data_of(strokes: StrokeTable, name: str) -> dict[str, Any]:
    """Collect the data for the page's scripts: stroke columns, outlines and colours, bottom to top."""
    height, width = strokes.size
    return {
        "name": name,
        "width": width,
        "height": height,
        "mm": strokes.mm,
        "names": list(strokes.columns),  # in order, which JSON in a template does not keep
        "columns": {key: [float(f"{value:.5g}") for value in column] for key, column in strokes.columns.items()},
        "lines": [line.round(1).tolist() for line in strokes.lines],
        "outlines": [outline.round(1).tolist() for outline in strokes.outlines],
        "colors": ["#" + bytes((255 * color).round().astype(np.uint8)).hex() for color in strokes.color.clip(0, 1)],
    }


def _raise_squares(row: Mapping[str, Any]) -> dict[str, Any]:
    """Replace ^2 with ² in the unit of a table row."""
    return {key: value.replace("^2", "²") if key == "unit" else value for key, value in row.items()}
