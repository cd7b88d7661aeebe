"""Draw contact sheets, which are grids of labelled pictures on white, for example of the runs in a sweep."""

import math
from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib import get_data_path
from pandas import DataFrame
from PIL import Image, ImageDraw, ImageFont

from brushexp.contracts import UserError
from brushexp.contracts.files import write_picture
from brushexp.contracts.pictures import open_picture
from brushexp.contracts.results import digits, is_album, numbers, run_count, shorten, varying_settings
from brushexp.contracts.runs import Status
from brushexp_studies.plotting import wrap_text

THUMBNAIL_SIDE = 400  # longer side of a picture in pixels if the sheet has room
LIMIT = 6000  # approximate maximum side of a sheet in pixels
GAP = 16  # pixels between pictures
TALL = 1.7  # maximum height of a picture with its label, in sides
LETTER, LETTER_WIDTH, LINE = 0.04, 0.58, 1.35  # height of letters in sides; their mean width and line height in heights
PAPER, INK, BOX = "white", "#202020", "#ededed"
COLUMNS = 6  # number of columns for up to 48 pictures; larger sheets are approximately square
TARGET = "target"
UNITS = {"psnr": "dB", "psnr_alpha": "dB in alpha", "seconds": "s"}  # units of the metrics below a picture


@dataclass(frozen=True)
class SheetCell:
    """One cell of a contact sheet: a picture, or words in a grey box, with lines of text below."""

    picture: Path | Image.Image | None
    label: tuple[str, ...] = ()
    words: str = ""


def write_contact_sheet(folder: Path, frame: DataFrame) -> Path | None:
    """Write ``sheet.png`` with the pictures of a sweep's runs; return None if no run has a picture.

    Thumbnails are twice as large unless all pictures are named ``painting.png``. If the runs differ in two settings and
    cover all combinations, they form a matrix; if one of the settings is the image, the matrix has a row per image.
    Otherwise the runs fill the sheet row by row.
    """
    pictures = frame["run", "picture"].dropna()
    if pictures.empty:
        return None
    side = THUMBNAIL_SIDE if all(path.name == "painting.png" for path in pictures) else 2 * THUMBNAIL_SIDE
    sheet = draw_sheet(_rows(frame), f"{folder.resolve().name}: {run_count(frame)}", side)
    write_picture(folder / "sheet.png", np.asarray(sheet))
    return folder / "sheet.png"


def _rows(frame: DataFrame) -> list[list[SheetCell]]:
    """Arrange a sweep's runs in rows of cells."""
    axes = varying_settings(frame)
    if not any("loss" in typed for typed in frame["run", "overrides"]):
        axes.pop("loss", None)  # determined by another setting
    settings = frame["setting"][list(axes)].fillna("")
    complete = not settings.duplicated().any() and len(frame) == math.prod(map(len, axes.values()))
    if len(axes) == 2 and complete:
        down, across = sorted(axes, key=lambda key: (key != "image", len(axes[key])))
        table = settings.reset_index(names="run").pivot(index=down, columns=across, values="run")
        rows = [_cells(frame.loc[list(row)], axes) for row in table.loc[axes[down], axes[across]].to_numpy()]
        return [sorted(row, key=lambda cell: cell.label != (TARGET,)) for row in rows]
    cells = _cells(frame, axes)
    n = len(cells)
    columns = math.ceil(n / math.ceil(n / COLUMNS)) if n <= 8 * COLUMNS else math.ceil(math.sqrt(n))
    return [cells[i : i + columns] for i in range(0, n, columns)]


def _cells(frame: DataFrame, axes: dict[str, list[str]]) -> list[SheetCell]:
    """Make a cell for each run and, except in an album, one for each target, before the first run that painted it."""
    words = {key: shorten(values) for key, values in axes.items()}
    settings, metrics = frame["setting"].fillna(""), numbers(frame).reindex(columns=list(UNITS))
    cells: list[SheetCell] = []
    targets = {*frame["run", "target"]} if is_album(frame) else set()
    for name, run in frame["run"].iterrows():
        if run["target"] not in targets and (run["folder"] / "target.png").is_file():
            targets.add(run["target"])
            cells.append(SheetCell(run["folder"] / "target.png", (TARGET,)))
        label = "   ".join(f"{key}={names[settings.loc[name, key]]}" for key, names in words.items())
        if run["status"] == Status.FAILED:
            cells.append(SheetCell(None, (label, f"run {name}"), f"failed: {run['error']}"))
            continue
        values = [f"{x:.{digits()[key]}f} {UNITS[key]}" for key, x in metrics.loc[name].dropna().items()]
        status = [run["status"]] * (run["status"] != Status.COMPLETED)
        cells.append(SheetCell(run["picture"], (label, "   ".join([*status, *values, f"run {name}"])), "no picture"))
    return cells


def draw_sheet(rows: Sequence[Sequence[SheetCell]], title: str, side: int = THUMBNAIL_SIDE) -> Image.Image:
    """Draw rows of pictures whose longer sides are ``side`` pixels long, or shorter if the sheet would be too large."""
    columns = max(map(len, rows))
    side = max(1, min(side, int(LIMIT / max(columns, TALL * len(rows))) - GAP))
    letter = max(10, round(LETTER * side))
    # Matplotlib's font has more glyphs than Pillow's.
    path = Path(get_data_path()) / "fonts" / "ttf" / "DejaVuSans.ttf"
    font, large = (ImageFont.truetype(path, size) for size in (letter, letter * 5 // 4))
    line, letters = round(LINE * letter), max(1, int(side / (LETTER_WIDTH * letter)))
    pictures = [[_picture(cell, side) or _box(cell.words, side, letters, font) for cell in row] for row in rows]
    labels = [["\n".join(wrap_text(text, letters) for text in cell.label) for cell in row] for row in rows]
    tops = [2 * (line + GAP)]
    for row, texts in zip(pictures, labels, strict=True):
        lines = max(1 + text.count("\n") for text in texts)
        tops.append(tops[-1] + max(picture.height for picture in row) + GAP + line * lines)
    width = max(columns * (side + GAP), math.ceil(large.getlength(title)) + GAP) + GAP
    sheet = Image.new("RGB", (width, tops[-1]), PAPER)
    draw = ImageDraw.Draw(sheet)
    draw.text((GAP, GAP), title, INK, large)
    for k, row in enumerate(pictures):
        for m, picture in enumerate(row):
            left, top = GAP + m * (side + GAP), tops[k]
            sheet.paste(picture, (left + (side - picture.width) // 2, top))
            place = left + side // 2, top + picture.height + line // 4
            draw.multiline_text(place, labels[k][m], INK, font, anchor="ma", align="center")
    return sheet


def _box(words: str, side: int, letters: int, font: ImageFont.FreeTypeFont) -> Image.Image:
    box = Image.new("RGB", (side, max(1, side * 3 // 5)), BOX)
    place = side // 2, box.height // 2
    ImageDraw.Draw(box).multiline_text(place, wrap_text(words, letters, most=8), INK, font, anchor="mm", align="center")
    return box


def _picture(cell: SheetCell, side: int) -> Image.Image | None:
    """Resize a cell's picture; return None if it does not exist or cannot be read."""
    source = cell.picture
    if source is None:
        return None
    try:
        with nullcontext(source) if isinstance(source, Image.Image) else open_picture(source) as picture:
            zoom = side / max(picture.size)
            size = max(1, round(picture.width * zoom)), max(1, round(picture.height * zoom))
            method = Image.Resampling.NEAREST if zoom > 1 else Image.Resampling.BICUBIC  # enlarged pixels stay visible
            return picture.convert("RGB").resize(size, method, reducing_gap=2.0)
    except UserError:
        return None
