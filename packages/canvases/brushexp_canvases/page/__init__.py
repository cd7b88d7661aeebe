"""Write a page that shows a pyramid, with panning, zooming, a comparison slider, and sharp strokes up close.

Strokes are stored in square cells. Each cell is a script next to the page, loaded when its area is viewed up close.
"""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch

from brushexp.contracts.families import ExportJob
from brushexp.contracts.files import write_text
from brushexp.contracts.pages import pack_strokes, pack_textures, page, textured_profile_of
from brushexp.contracts.pictures import Region
from brushexp_canvases.laying import mark_overlapping
from brushexp_canvases.pyramid import TILE, Level, atomic_folder, write_dzi

TEMPLATES = Path(__file__).parent / "templates"
PAGE_NAME = "view.html"
CELL = TILE  # side of a cell in pixels; a multiple of the side of magnified tiles
CELLS = 4  # side, in cells, of the parts whose strokes are searched at once
FOLDER = "strokes_files"
JobOf = Callable[[Region], ExportJob]


def write_page(
    folder: Path, size: tuple[int, int], names: list[str], title: str, lead: str, strokes: dict[str, Any] | None = None
) -> Path:
    """Write ``view.html``, a page that shows the Deep Zoom images in its folder, with or without a web server.

    ``names`` are the names of the images, all of ``size`` (H, W). The first image is the painting; another image may be
    called ``target``. ``strokes`` is the result of `write_strokes`.
    """
    layers = [*names[1:], *(["difference"] if "target" in names else [])]
    data = {"height": size[0], "width": size[1], "tile": TILE, "names": names, "strokes": strokes}
    text = page("view.html.j2", TEMPLATES, title=title, lead=lead, layers=layers, data=data)
    write_text(path := folder / PAGE_NAME, text)
    return path


def write_viewer(folder: Path, levels: dict[str, list[Level]], title: str, count: int, job_of: JobOf) -> None:
    """Write a painting with ``count`` strokes, and other pictures of the same size, as Deep Zoom images with a page."""
    for name, pictures in levels.items():
        write_dzi(folder, name, pictures)
    height, width = size = levels["painting"][0].size
    lead = f"{count:,} strokes on {width:,} × {height:,} pixels"
    write_page(folder, size, list(levels), title, lead, write_strokes(folder, size, job_of))


def write_strokes(folder: Path, size: tuple[int, int], job_of: JobOf) -> dict[str, Any]:
    """Write the strokes of a painting of ``size`` (H, W), and return the data that the page needs to load them.

    ``job_of`` returns all strokes that reach into a region, in pixels relative to its corner. Each ``column_row.js``
    calls `brushexp.cell` with the output of `pack_strokes` for the strokes that reach into one cell, in pixels relative
    to the cell's corner; a stroke is stored in every cell that it reaches into. ``textures.js`` contains all textures.
    """
    exact, textures = True, None
    with atomic_folder(folder / FOLDER) as into:
        for part in Region(0, 0, *size).tiles(CELLS * CELL):
            job = job_of(part)
            for cell in Region(0, 0, part.height, part.width).tiles(CELL):
                packed = pack_strokes(_within(job, cell, size))
                exact = exact and packed["exact"] and job.is_bare
                name = f"{(part.left + cell.left) // CELL}_{(part.top + cell.top) // CELL}"
                _write_call(into, name, packed)
            textures = textures or textured_profile_of(job)
        if textures is not None:
            sheets = textures.sheets
            _write_call(into, "textures", pack_textures(sheets, np.arange(len(sheets.size))))
    return {"folder": FOLDER, "cell": CELL, "exact": exact, "textured": textures is not None}


def of_all(job: ExportJob) -> JobOf:
    """Return a function that keeps only the strokes of a painting that reach into a given region."""
    return lambda part: _within(job, part, job.size)


def _within(job: ExportJob, part: Region, size: tuple[int, int]) -> ExportJob:
    """Keep the strokes that reach into a region, relative to its corner; the whole painting has ``size`` (H, W)."""
    number = job.bottom_up[mark_overlapping(job.strokes, part, job.renderer.edge)[job.bottom_up]]
    strokes = job.strokes[number].moved(shift=(-part.left, -part.top))
    depth = torch.arange(len(number), dtype=torch.int32)
    return replace(job, saved=replace(job.saved, strokes=strokes, depth=depth, size=size))


def _write_call(folder: Path, name: str, packed: dict[str, Any]) -> None:
    text = json.dumps(packed, separators=(",", ":"))
    (folder / f"{name}.js").write_text(f'brushexp.cell("{name}",{text});\n', encoding="utf-8")
