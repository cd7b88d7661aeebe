"""``task=brushes``: draw a sheet that shows the marks read from brush files and strokes painted with them."""

import logging
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch
from omegaconf import DictConfig
from PIL import Image, ImageDraw

from brushexp.contracts.families import window_pictures
from brushexp.contracts.files import as_shown, write_picture
from brushexp_media.brushes.brush import Brush, marks_of
from brushexp_media.brushes.marks import Mark

log = logging.getLogger(__name__)
HIGH, WIDE, LINE = 128, 384, 18  # pixels: height of a row, width of the mark in it, height of the name above
STROKES = [  # a long straight, a curved and a thin stroke: three points, width and black, as in training
    [-0.8, 0, 0, 0, 0.8, 0, 0.6, -1, -1, -1],
    [-0.8, 0.5, 0, -1.0, 0.8, 0.5, 0.0, -1, -1, -1],
    [-0.8, 0.3, 0, 0.1, 0.8, -0.3, -0.9, -1, -1, -1],
]


def run(cfg: DictConfig, folder: Path, start: float) -> dict[str, object]:
    """Write the sheet ``brushes.png`` for the files in ``cfg.brushes``."""
    marks, brush = marks_of(cfg.brushes), Brush(files=[*cfg.brushes]).eval()
    write_picture(path := folder / "brushes.png", sheet_of(marks, brush))
    chosen = f"brush={','.join(cfg.brushes)}" if cfg.brushes else "renderer=brush"
    count = f"{len(marks)} mark{'' if len(marks) == 1 else 's'}"
    log.info("%s: %s; paint with it: brushexp PICTURE %s", as_shown(path), count, chosen)
    return {"n_marks": len(marks)}


def sheet_of(marks: Sequence[Mark], brush: Brush) -> np.ndarray:
    """Draw a sheet (H, W, 3), uint8, with a row for each mark: the mark as read, and strokes painted with it."""
    sheet = Image.new("RGB", (WIDE + (len(STROKES)) * HIGH, len(marks) * (HIGH + LINE)), "white")
    for k, mark in enumerate(marks):
        top = k * (HIGH + LINE) + LINE
        ImageDraw.Draw(sheet).text((4, top - LINE + 2), mark.name, fill="#666")
        read = Image.fromarray((255 * (1 - mark.coverage)).round().astype(np.uint8))
        read.thumbnail((WIDE - 8, HIGH - 8))
        sheet.paste(read, (4, top + (HIGH - read.height) // 2))
        for i, picture in enumerate(strokes_with(brush, k)):
            sheet.paste(Image.fromarray(picture), (WIDE + i * HIGH, top))
    return np.asarray(sheet)


@torch.no_grad()
def strokes_with(brush: Brush, number: int) -> list[np.ndarray]:
    """Draw each of ``STROKES`` with one mark, black on white, as a picture (HIGH, HIGH), uint8."""
    parameters = torch.tensor(STROKES, dtype=torch.float32)
    alpha = window_pictures(brush, parameters, HIGH, torch.full((len(STROKES),), number))[:, 3]
    return [*(255 * (1 - alpha)).round().to(torch.uint8).numpy()]
