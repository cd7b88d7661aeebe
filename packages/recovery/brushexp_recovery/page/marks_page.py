"""Write a page that shows a picture with the marks that were found or missed, and with the extra strokes."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from brushexp.contracts.files import write_text
from brushexp.contracts.pages import embed, page
from brushexp_recovery.marks.mark_score import State
from brushexp_recovery.page.stroke_page import JPEG, TEMPLATES

Array = NDArray[Any]
Outlined = tuple[str, State, Sequence[Array]]  # name, state and outlines (P, 2) of a mark or a stroke

LARGEST_SIDE = 2400  # maximum side in pixels of the picture in the page
GREY = 200  # level that replaces a missing picture


def write_marks_page(
    path: Path,
    *,
    image: Array | None,
    size: tuple[int, int],
    name: str,
    marks: Sequence[Outlined],
    strokes: Sequence[Outlined],
    summary: str,
    meaning: str,
) -> None:
    """Write a self-contained page that can be opened from disk.

    ``image`` (H, W, 3) is in [0, 1]; if it is None, a grey picture is shown instead.
    """
    height, width = size
    pixels = np.full((height, width, 3), GREY, np.uint8) if image is None else (255 * image).round().astype(np.uint8)
    html = page(
        "marks.html.j2",
        TEMPLATES,
        name=name,
        width=width,
        height=height,
        photograph=embed(Image.fromarray(pixels), LARGEST_SIDE, **JPEG)["source"],
        layers=[
            ("unjudged", "not judged", shapes_of(strokes, State.UNJUDGED)),
            ("extra", "extra", shapes_of(strokes, State.EXTRA)),
            ("partner", "strokes found", shapes_of(strokes, State.FOUND)),
            ("missed", "missed", shapes_of(marks, State.MISSED)),
            ("found", "marks found", shapes_of(marks, State.FOUND)),
        ],
        summary=summary,
        meaning=meaning,
    )
    write_text(path, html)


def shapes_of(outlined: Sequence[Outlined], state: State) -> list[tuple[str, str]]:
    """List the names and SVG paths of all marks or strokes that are in a given state."""
    return [(name, path_of(outlines)) for name, of, outlines in outlined if of == state]


def path_of(outlines: Sequence[Array]) -> str:
    """Convert closed outlines (P, 2) to an SVG path."""
    return " ".join(
        "M" + " ".join(f"{x:.1f},{y:.1f}" for x, y in outline) + "Z" for outline in outlines if len(outline)
    )
