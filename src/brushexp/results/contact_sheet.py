"""Pictures in a grid on white paper, with headings and labels; and such a sheet of all runs of a sweep."""

from __future__ import annotations

import io
import math
import unicodedata
from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from itertools import accumulate
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
FAILED = "failed"  # above the words
COLUMNS = 6  # up to 48 pictures; larger sheets are about square
MATRIX_COLUMNS = 12  # a wider matrix is laid out row by row instead
LEGIBLE = 160  # pixels: and so is a matrix with smaller pictures
UNITS = {"psnr": "dB", "psnr_alpha": "dB in alpha", "seconds": "s"}  # of the metrics below a picture


@dataclass(frozen=True)
class SheetCell:
    """One place of a sheet: a picture (or its file), or words in a grey box, and a label below it."""

    picture: Path | Image.Image | None
    label: tuple[str, ...] = ()  # pieces between which a line may end
    note: tuple[str, ...] = ()  # below the label, fainter
    words: str = ""  # in the box
    failed: bool = False


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
        table = settings.reset_index(names="run").pivot(index=down, columns=across, values="run")
        names = table.loc[axes[down], axes[across]].to_numpy()
        targets = [_targets_of(frame.loc[row, "run"]) for row in names]
        rows = [
            [*(SheetCell(path) for path in found), *(_cell(name, frame.loc[name]) for name in row)]
            for found, row in zip(targets, names, strict=True)
        ]
        fits = len(axes[across]) <= MATRIX_COLUMNS and fitting_side(rows, True, side) >= LEGIBLE
        if fits and all(len(found) == any(targets) for found in targets):
            columns = [f"{across}={name}" for name in shortened(axes[across]).values()]
            heads = [f"{down}={name}" for name in shortened(axes[down]).values()]
            return draw_sheet(rows, title, heads, ["target"] * any(targets) + columns, side)
    return None


def _targets_of(runs: DataFrame) -> list[Path]:
    """The pictures that these runs have painted, each once."""
    paths = {run["target"]: run["folder"] / "target.png" for _, run in runs.iterrows()}
    return [path for path in paths.values() if path.is_file()]


def _cell(name: str, run: Series, label: tuple[str, ...] = ()) -> SheetCell:
    told = run["run"]
    if told["status"] == "failed":
        return SheetCell(None, label, (f"run {name}",), words=str(told["error"]), failed=True)
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
    type_ = Lettering.beside(side)
    pictures = [[_scaled(cell.picture, side) for cell in row] for row in rows]
    sizes = [picture.size for row in pictures for picture in row if picture] or [(side, side * 3 // 4)]
    width = max(side * 2 // 3, *(size[0] for size in sizes))
    heads = [type_.lines((head,), side * 3 // 5, HEAD_LINES) for head in row_heads]
    gutter = max((math.ceil(type_.font.getlength(text)) for head in heads for text in head), default=0)
    bands = [[type_.drawn(type_.lines((head,), width, HEAD_LINES), width) for head in column_heads]]
    for row, found in zip(rows, pictures, strict=True):
        pairs = zip(row, found, strict=True)
        bands.append(
            [_tile(cell, picture or _in_words(cell, sizes[0], type_), width, type_) for cell, picture in pairs]
        )
    for band, lines in zip(bands, [[], *heads], strict=True) if heads else ():
        band.insert(0, type_.drawn(lines, gutter, max((image.height for image in band), default=0)))
    large, title = ImageFont.load_default(round(type_.size * 1.25)), plain_letters(title)
    grid = _stacked([_stacked(band, type_.gap, down=False) for band in bands if band], type_.gap, down=True)
    width = 2 * type_.gap + math.ceil(max(grid.width, large.getlength(title)))
    sheet = Image.new("RGB", (width, grid.height + 2 * type_.gap + 2 * type_.line), PAPER)
    sheet.paste(grid, (type_.gap, type_.gap + 2 * type_.line))
    ImageDraw.Draw(sheet).text((type_.gap, type_.gap), title, INK, large)
    return sheet


@dataclass(frozen=True)
class Lettering:
    """Letters in proportion to the pictures: their height, that of a line, and the gap between pictures, in pixels."""

    size: int
    line: int
    gap: int

    @staticmethod
    def beside(side: int) -> Lettering:
        """Lettering for pictures of this size."""
        size = max(11, round(side * 0.048))
        return Lettering(size, round(size * 1.35), max(8, round(side * 0.06)))

    @property
    def font(self) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
        """Pillow's own, which has the letters of ASCII."""
        return ImageFont.load_default(self.size)

    def lines(self, words: Sequence[str], width: int, most: int, space: str = "   ") -> list[str]:
        """Words in at most so many lines of this width."""
        font = self.font
        found = wrapped(map(plain_letters, words), lambda text: font.getlength(text) <= width, most, space)
        return [text for text in found if text]

    def drawn(
        self, lines: Sequence[str], width: int, height: int = 0, *, faint: int = 0, paper: str = PAPER
    ) -> Image.Image:
        """Lines in the middle of a box; the last ones faint."""
        box = Image.new("RGB", (max(width, 1), max(height, len(lines) * self.line, 1)), paper)
        top = (box.height - len(lines) * self.line) // 2
        for k, text in enumerate(lines):
            color = ALARM if text == FAILED else INK if k < len(lines) - faint else FAINT
            ImageDraw.Draw(box).text((width // 2, top + k * self.line), text, color, self.font, anchor="ma")
        return box


def fitting_side(rows: Sequence[Sequence[SheetCell]], heads: bool, side: int) -> int:
    """Longer side of the pictures, so that the sheet stays below its limit whatever the labels say."""
    columns = max(map(len, rows)) + heads
    for smaller in range(side, SMALLEST_SIDE, -10):
        type_ = Lettering.beside(smaller)
        width = columns * (smaller + type_.gap) + 2 * type_.gap
        height = len(rows) * (smaller + LABEL_LINES * type_.line + type_.gap) + (HEAD_LINES + 4) * type_.line
        if max(width, height) <= LIMIT and width * height <= AREA:
            return smaller
    return SMALLEST_SIDE


def plain_letters(text: str) -> str:
    """The text in ASCII, all that Pillow's own font holds: é becomes e, and what has no such form a question mark."""
    parts = unicodedata.normalize("NFKD", text)
    return "".join(part for part in parts if not unicodedata.combining(part)).encode("ascii", "replace").decode()


def _tile(cell: SheetCell, picture: Image.Image, width: int, type_: Lettering) -> Image.Image:
    """A picture with a frame, and its label and note below it."""
    ImageDraw.Draw(picture).rectangle((0, 0, picture.width - 1, picture.height - 1), outline=RULE)
    note = type_.lines(cell.note, width, 2)
    lines = type_.lines(cell.label, width, LABEL_LINES - len(note)) + note
    text = [type_.drawn(lines, width, faint=len(note))] if lines else []
    column = Image.new("RGB", (width, picture.height), PAPER)
    column.paste(picture, ((width - picture.width) // 2, 0))
    return _stacked([column, *text], round(0.3 * type_.line), down=True)


def _in_words(cell: SheetCell, size: tuple[int, int], type_: Lettering) -> Image.Image:
    """A grey box that says why there is no picture."""
    most = max(0, min(WORD_LINES, size[1] // type_.line - 2))
    words = (cell.words or "the picture cannot be read").split()
    lines = type_.lines(words, size[0] - type_.line, most, " ") if most else []
    return type_.drawn([FAILED] * cell.failed + lines, *size, paper=BOX).crop((0, 0, *size))


def _stacked(images: Sequence[Image.Image], gap: int, *, down: bool) -> Image.Image:
    """Pictures below or beside each other on white."""
    along = [image.height if down else image.width for image in images]
    across = max(image.width if down else image.height for image in images)
    total = sum(along) + gap * (len(images) - 1)
    sheet = Image.new("RGB", (across, total) if down else (total, across), PAPER)
    for image, place in zip(images, accumulate([0, *(length + gap for length in along)]), strict=False):
        sheet.paste(image, (0, place) if down else (place, 0))
    return sheet


def _scaled(source: Path | Image.Image | None, side: int) -> Image.Image | None:
    """A picture whose longer side has so many pixels; None if there is none or it cannot be read."""
    if source is None:
        return None
    try:
        with nullcontext(source) if isinstance(source, Image.Image) else Image.open(source) as picture:
            zoom = side / max(picture.size)
            zoom = int(zoom) if zoom > 1 else zoom  # small pictures show their pixels
            size = max(1, round(picture.width * zoom)), max(1, round(picture.height * zoom))
            method = Image.Resampling.NEAREST if zoom > 1 else Image.Resampling.BICUBIC
            return picture.convert("RGB").resize(size, method, reducing_gap=2.0)
    except UNREADABLE:
        return None
