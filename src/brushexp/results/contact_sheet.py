"""Pictures in a grid on white paper, with headings and labels; and such a sheet of all runs of a sweep."""

from __future__ import annotations

import io
import math
import unicodedata
from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from PIL import Image, ImageDraw, ImageFont

from brushexp.results.plotting import wrapped
from brushexp.results.runs import UNREADABLE, shortened
from brushexp.results.tables import DIGITS, as_text, run_count, varying
from brushexp.system.files import write_bytes

if TYPE_CHECKING:
    from pandas import DataFrame, Series

SIDE = 400  # pixels: longer side of a picture, where the sheet has room
SMALLEST_SIDE = 40
LIMIT = 8000  # pixels: side of a sheet
AREA = 24_000_000  # pixels: of a sheet, which is drawn anew after every run
LABEL_LINES, HEAD_LINES, WORD_LINES = 4, 4, 6  # at most
PAPER, INK, FAINT, BOX, RULE, ALARM = "white", "#202020", "#6a6a6a", "#ededed", "#d4d4d4", "#b00020"
WIDE_SPACE = "   "
COLUMNS = 6  # up to 48 pictures; larger sheets are about square
MATRIX_COLUMNS = 12  # a wider matrix is laid out row by row instead
LEGIBLE = 160  # pixels: and so is a matrix with smaller pictures
UNITS = {"psnr": "dB", "psnr_alpha": "dB in alpha", "seconds": "s"}  # of the metrics below a picture

Font = ImageFont.FreeTypeFont | ImageFont.ImageFont


@dataclass(frozen=True)
class SheetCell:
    """One place of a sheet: a picture (or its file), or words in a grey box, and a label below it."""

    picture: Path | Image.Image | None
    label: tuple[str, ...] = ()  # pieces between which a line may end
    note: tuple[str, ...] = ()  # below the label, fainter
    alarm: str = ""  # first line in the box
    words: str = ""


def write_contact_sheet(folder: Path, frame: DataFrame) -> Path | None:
    """Write ``sheet.png`` of a sweep; None if no run has left a picture.

    A picture of many strokes gets twice the room. Runs that differ in two settings and cover all combinations form a
    matrix; others stand row by row.

    Args:
        folder: where to.
        frame: the runs, see `brushexp.results.runs`.
    """
    pictures = frame["run", "picture"].dropna()
    if pictures.empty:
        return None
    side = SIDE if all(path.name == "painting.png" for path in pictures) else 2 * SIDE
    title = f"{folder.resolve().name}: {run_count(frame)}"
    sheet = _matrix(frame, title, side) or draw_sheet(_row_by_row(frame), title, side=side)
    encoded = io.BytesIO()
    sheet.save(encoded, format="PNG", compress_level=1)  # a third of the usual time
    write_bytes(folder / "sheet.png", encoded.getvalue())
    return folder / "sheet.png"


def _row_by_row(frame: DataFrame) -> list[list[SheetCell]]:
    """Every target stands before the first run that was painted after it."""
    words = {key: shortened(values) for key, values in varying(frame).items()}
    cells: list[SheetCell] = []
    shown = set()
    for name, run in frame.iterrows():
        target = run["run", "folder"] / "target.png"
        if target.is_file() and run["run", "target"] not in shown:
            shown.add(run["run", "target"])
            cells.append(SheetCell(target, ("target",)))
        chosen = run["setting"].fillna("")
        cells.append(_cell(name, run, tuple(f"{key}={names[chosen[key]]}" for key, names in words.items())))
    n = len(cells)
    columns = math.ceil(n / math.ceil(n / COLUMNS)) if n <= 8 * COLUMNS else math.ceil(math.sqrt(n))
    return [cells[i : i + columns] for i in range(0, n, columns)]


def _matrix(frame: DataFrame, title: str, side: int) -> Image.Image | None:
    """One setting across, one down, and the target at the head of every row; None if the runs are no such grid."""
    axes = varying(frame)
    settings = frame["setting"][list(axes)].fillna("")
    if len(axes) != 2 or settings.duplicated().any() or len(frame) != math.prod(map(len, axes.values())):
        return None
    wide_first = sorted(axes, key=lambda key: (len(axes[key]) > COLUMNS, -len(axes[key])))
    for across, down in (wide_first, wide_first[::-1]):
        names = settings.reset_index(names="name").pivot(index=down, columns=across, values="name")
        names = names.loc[axes[down], axes[across]].to_numpy()  # of the runs
        targets = [_target_of(frame.loc[row, "run"]) for row in names]
        kept = any(targets)
        rows = [
            [*(SheetCell(path) for path in found), *(_cell(name, frame.loc[name]) for name in row)]
            for found, row in zip(targets, names, strict=True)
        ]
        columns = ["target"] * kept + [f"{across}={name}" for name in shortened(axes[across]).values()]
        heads = [f"{down}={name}" for name in shortened(axes[down]).values()]
        fits = len(axes[across]) <= MATRIX_COLUMNS and fitting_side(rows, bool(heads), side) >= LEGIBLE
        if fits and all(len(found) == kept for found in targets):
            return draw_sheet(rows, title, heads, columns, side)
    return None


def _target_of(runs: DataFrame) -> list[Path]:
    """The pictures that these runs have painted, each once."""
    paths = {run["target"]: run["folder"] / "target.png" for _, run in runs.iterrows()}
    return [path for path in paths.values() if path.is_file()]


def _cell(name: str, run: Series, label: tuple[str, ...] = ()) -> SheetCell:
    told = run["run"]
    if told["status"] == "failed":
        return SheetCell(None, label, (f"run {name}",), alarm="failed", words=str(told["error"]))
    state = () if told["status"] == "completed" else (told["status"],)
    numbers = run["metric"].reindex(list(UNITS)).dropna().to_frame().T
    shown = as_text(numbers, DIGITS).iloc[0] if len(numbers.columns) else {}
    note = (*state, *(f"{text} {UNITS[key]}" for key, text in shown.items()), f"run {name}")
    return SheetCell(told["picture"], label, note, words="" if told["picture"] else "no picture")


def draw_sheet(
    rows: Sequence[Sequence[SheetCell]], title: str, row_heads: Sequence[str] = (), column_heads: Sequence[str] = (),
    side: int = SIDE,
) -> Image.Image:  # fmt: skip
    """Draw pictures in rows, with a title above them.

    Args:
        rows: what stands where.
        title: of the sheet.
        row_heads: headings on the left, one for each row, or none.
        column_heads: headings above, one for each column, or none.
        side: pixels of the longer side of a picture, at most; less where the sheet would be too large.
    """
    side = fitting_side(rows, bool(row_heads), side)
    size, line, gap = _lettering(side)
    font, large = ImageFont.load_default(size), ImageFont.load_default(round(size * 1.25))
    sizes = [[_scaled_size(cell.picture, side) for cell in row] for row in rows]
    known = [[size for size in row if size] for row in sizes]
    box = next((row[0] for row in known if row), (side, side * 3 // 4))
    boxes = [row[0] if row else box for row in known]  # of places without a picture
    width = max(side * 2 // 3, *(size[0] for row in [boxes, *known] for size in row))
    heads = [_lines((head,), font, side * 3 // 5, HEAD_LINES) for head in row_heads]
    tops = [_lines((head,), font, width, HEAD_LINES) for head in column_heads]
    gutter = max((round(font.getlength(text)) for head in heads for text in head), default=-gap)
    labels = [[_label(cell, font, width) for cell in row] for row in rows]
    left = 2 * gap + gutter
    ys = [gap + round((2.2 + max(map(len, tops), default=0)) * line)]
    heights = [max(size[1] for size in [empty, *row]) for empty, row in zip(boxes, known, strict=True)]
    for height, told in zip(heights, labels, strict=True):
        ys.append(ys[-1] + height + round((max(len(text) + len(note) for text, note in told) + 0.3) * line) + gap)
    right = max(left + max(map(len, rows)) * (width + gap), round(2 * gap + large.getlength(plain_letters(title))))

    sheet = Image.new("RGB", (right, ys[-1]), PAPER)
    pen = ImageDraw.Draw(sheet)
    pen.text((gap, gap), plain_letters(title), INK, large)
    for k, top in enumerate(tops):
        _write(pen, font, line, top, left + k * (width + gap) + width // 2, ys[0] - round((len(top) + 0.3) * line))
    for head, y, height in zip(heads, ys, heights, strict=False):
        _write(pen, font, line, head, gap + gutter // 2, y + (height - len(head) * line) // 2)
    for row, row_labels, y, height, empty in zip(rows, labels, ys, heights, boxes, strict=False):
        for k, (cell, (text, note)) in enumerate(zip(row, row_labels, strict=True)):
            picture = _scaled(cell.picture, side) or _in_words(cell, empty, font, line)
            middle = left + k * (width + gap) + width // 2
            x = middle - picture.width // 2
            sheet.paste(picture, (x, y))
            pen.rectangle((x, y, x + picture.width - 1, y + picture.height - 1), outline=RULE)
            below = y + height + round(0.3 * line)
            _write(pen, font, line, text, middle, below)
            _write(pen, font, line, note, middle, below + len(text) * line, FAINT)
    return sheet


def fitting_side(rows: Sequence[Sequence[SheetCell]], with_heads: bool, side: int) -> int:
    """Longer side of the pictures, so that the sheet stays below its limit whatever the labels say."""
    columns = max(map(len, rows)) + with_heads
    for smaller in range(side, SMALLEST_SIDE, -10):
        _, line, gap = _lettering(smaller)
        width = columns * (smaller + gap) + 2 * gap
        height = len(rows) * (smaller + LABEL_LINES * line + gap) + (HEAD_LINES + 4) * line
        if max(width, height) <= LIMIT and width * height <= AREA:
            return smaller
    return SMALLEST_SIDE


def plain_letters(text: str) -> str:
    """The text in ASCII, all that Pillow's own font holds: é becomes e, and what has no such form a question mark."""
    parts = unicodedata.normalize("NFKD", text)
    return "".join(part for part in parts if not unicodedata.combining(part)).encode("ascii", "replace").decode()


def _lettering(side: int) -> tuple[int, int, int]:
    """Height of letters, of a line, and the gap between pictures, all in pixels."""
    size = max(11, round(side * 0.048))
    return size, round(size * 1.35), max(8, round(side * 0.06))


def _lines(words: Sequence[str], font: Font, width: int, most: int, space: str = WIDE_SPACE) -> list[str]:
    """Words in at most so many lines of this width in pixels."""
    lines = wrapped(map(plain_letters, words), lambda text: font.getlength(text) <= width, most, space)
    return [text for text in lines if text]


def _label(cell: SheetCell, font: Font, width: int) -> tuple[list[str], list[str]]:
    note = _lines(cell.note, font, width, 2)
    return _lines(cell.label, font, width, LABEL_LINES - len(note)), note


def _write(
    pen: ImageDraw.ImageDraw, font: Font, line: int, texts: Sequence[str], middle: int, top: int, color: str = INK
) -> None:
    for k, text in enumerate(texts):
        pen.text((middle, top + k * line), text, color, font, anchor="ma")


def _in_words(cell: SheetCell, size: tuple[int, int], font: Font, line: int) -> Image.Image:
    """A grey box that says why there is no picture."""
    box = Image.new("RGB", size, BOX)
    most = max(0, min(WORD_LINES, size[1] // line - 2))
    words = (cell.words or "the picture cannot be read").split()
    texts = _lines(words, font, size[0] - line, most, " ") if most else []
    pen, top = ImageDraw.Draw(box), (size[1] - (len(texts) + bool(cell.alarm)) * line) // 2
    _write(pen, font, line, [cell.alarm] * bool(cell.alarm), size[0] // 2, top, ALARM)
    _write(pen, font, line, texts, size[0] // 2, top + bool(cell.alarm) * line)
    return box


def _scaled_size(source: Path | Image.Image | None, side: int) -> tuple[int, int] | None:
    """Size on the sheet, from the head of the file; None if there is none or it cannot be read."""
    if source is None:
        return None
    try:
        with nullcontext(source) if isinstance(source, Image.Image) else Image.open(source) as picture:
            width, height = picture.size
    except UNREADABLE:
        return None
    zoom = side / max(width, height)
    zoom = int(zoom) if zoom > 1 else zoom  # small pictures show their pixels
    return max(1, round(width * zoom)), max(1, round(height * zoom))


def _scaled(source: Path | Image.Image | None, side: int) -> Image.Image | None:
    size = _scaled_size(source, side)
    if source is None or size is None:
        return None
    try:
        with nullcontext(source) if isinstance(source, Image.Image) else Image.open(source) as picture:
            method = Image.Resampling.NEAREST if size[0] > picture.width else Image.Resampling.BICUBIC
            return picture.convert("RGB").resize(size, method, reducing_gap=2.0)
    except UNREADABLE:
        return None
