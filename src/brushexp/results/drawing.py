"""Pictures in a grid on white paper, with headings and labels."""

import re
import unicodedata
from collections.abc import Iterable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field
from pathlib import Path

from PIL import Image, ImageDraw, ImageFont

SIDE = 400  # pixels: longer side of a picture, where the sheet has room
SMALLEST_SIDE = 40
LIMIT = 8000  # pixels: side of a sheet
AREA = 24_000_000  # pixels: of a sheet, which is drawn anew after every run
LABEL_LINES, HEAD_LINES, WORD_LINES = 4, 4, 6  # at most
PAPER, INK, FAINT, BOX, RULE, ALARM = "white", "#202020", "#6a6a6a", "#ededed", "#d4d4d4", "#b00020"

WIDE_SPACE = "   "
UNREADABLE = (OSError, SyntaxError, ValueError, Image.DecompressionBombError)  # what Pillow raises

Size = tuple[int, int]
Lines = list[tuple[str, str]]  # text and colour


@dataclass(frozen=True)
class Cell:
    """One place of a sheet: a picture (or its file), or words in a grey box, and a label below it."""

    picture: Path | Image.Image | None
    label: tuple[str, ...] = ()  # pieces between which a line may end
    note: tuple[str, ...] = ()  # below the label, fainter
    alarm: str = ""  # first line in the box
    words: str = ""


@dataclass(frozen=True)
class Grid:
    """Cells in rows; headings are empty where there are none; a picture's longer side is ``side`` pixels at most."""

    rows: list[list[Cell]]
    row_heads: list[str] = field(default_factory=list)
    column_heads: list[str] = field(default_factory=list)
    side: int = SIDE


@dataclass(frozen=True)
class Type:
    """Lettering in proportion to the pictures."""

    font: ImageFont.FreeTypeFont | ImageFont.ImageFont
    title: ImageFont.FreeTypeFont | ImageFont.ImageFont
    line: int  # pixels from line to line
    gap: int  # pixels between pictures

    @staticmethod
    def beside(side: int) -> "Type":
        """Lettering for pictures of this size."""
        size, line, gap = _proportions(side)
        return Type(ImageFont.load_default(size), ImageFont.load_default(round(size * 1.25)), line, gap)

    def wrapped(self, words: Iterable[str], width: int, most: int, space: str = WIDE_SPACE) -> list[str]:
        """Set words in at most so many lines; long ones are broken, if possible after a sign."""
        lines = [""]
        for word in map(plain_letters, words):
            joined = f"{lines[-1]}{space}{word}" if lines[-1] else word
            if self._fits(joined, width):
                lines[-1] = joined
            else:
                lines += self._broken(word, width)
            if len(lines) > most + 1:  # the first may be empty
                break
        lines = [line for line in lines if line]
        if len(lines) > most:
            last = lines[most - 1]
            while last and not self._fits(last + "...", width):
                last = last[:-1]
            lines[most - 1 :] = [last + "..."]
        return lines

    def _broken(self, word: str, width: int) -> list[str]:
        lines = [""]
        for part in re.findall(r"[^/_,=+-]*[/_,=+-]|[^/_,=+-]+", word):
            if not self._fits(lines[-1] + part, width):
                lines.append("")
            for piece in [part] if self._fits(part, width) else part:
                if not self._fits(lines[-1] + piece, width) and lines[-1]:
                    lines.append("")
                lines[-1] += piece
        return lines

    def _fits(self, text: str, width: int) -> bool:
        return self.font.getlength(text) <= width


def _proportions(side: int) -> tuple[int, int, int]:
    """Height of letters, of a line, and the gap between pictures, all in pixels."""
    size = max(11, round(side * 0.048))
    return size, round(size * 1.35), max(8, round(side * 0.06))


def plain_letters(text: str) -> str:
    """The text in ASCII, all that Pillow's own font holds: é becomes e, and what has no such form a question mark."""
    parts = unicodedata.normalize("NFKD", text)
    return "".join(part for part in parts if not unicodedata.combining(part)).encode("ascii", "replace").decode()


def largest_side(grid: Grid) -> int:
    """Longer side of the pictures, so that the sheet stays below its limit whatever the labels say."""
    columns = max(map(len, grid.rows)) + bool(grid.row_heads)
    for side in range(grid.side, SMALLEST_SIDE, -10):
        _, line, gap = _proportions(side)
        width = columns * (side + gap) + 2 * gap
        height = len(grid.rows) * (side + LABEL_LINES * line + gap) + (HEAD_LINES + 4) * line
        if max(width, height) <= LIMIT and width * height <= AREA:
            return side
    return SMALLEST_SIDE


@dataclass(frozen=True)
class Layout:
    """Where everything goes, in pixels."""

    boxes: list[Size]  # of places without a picture, in each row
    width: int  # of a column
    gutter: int  # for the headings of the rows
    column_heads: list[Lines]
    row_heads: list[Lines]
    labels: list[list[Lines]]
    heights: list[int]  # of the pictures of each row
    xs: list[int]  # left edges of the columns, and the right edge of the sheet
    ys: list[int]  # upper edges of the rows, and the lower edge of the sheet


def draw(grid: Grid, title: str) -> Image.Image:
    """Draw the grid with a title above it."""
    side = largest_side(grid)
    type_ = Type.beside(side)
    plan = _plan(grid, side, type_)
    right = max(plan.xs[-1], round(2 * type_.gap + type_.title.getlength(title)))
    sheet = Image.new("RGB", (right, plan.ys[-1]), PAPER)
    pen = ImageDraw.Draw(sheet)
    pen.text((type_.gap, type_.gap), plain_letters(title), INK, type_.title)
    for head, x in zip(plan.column_heads, plan.xs, strict=False):
        _write(pen, type_, head, x + plan.width // 2, plan.ys[0] - round((len(head) + 0.3) * type_.line))
    for head, y, height in zip(plan.row_heads, plan.ys, plan.heights, strict=False):
        _write(pen, type_, head, type_.gap + plan.gutter // 2, y + (height - len(head) * type_.line) // 2)
    for row, y, height, labels, box in zip(grid.rows, plan.ys, plan.heights, plan.labels, plan.boxes, strict=False):
        for cell, x, label in zip(row, plan.xs, labels, strict=False):
            picture = _scaled(cell.picture, side) or _in_words(cell, box, type_)
            left = x + (plan.width - picture.width) // 2
            sheet.paste(picture, (left, y))
            pen.rectangle((left, y, left + picture.width - 1, y + picture.height - 1), outline=RULE)
            _write(pen, type_, label, x + plan.width // 2, y + height + round(0.3 * type_.line))
    return sheet


def _plan(grid: Grid, side: int, type_: Type) -> Layout:
    sizes = [[size for cell in row if (size := _scaled_size(cell.picture, side))] for row in grid.rows]
    box = next((row[0] for row in sizes if row), (side, side * 3 // 4))
    boxes = [row[0] if row else box for row in sizes]
    width = max(side * 2 // 3, *(size[0] for row in [boxes, *sizes] for size in row))
    heights = [max(size[1] for size in [row_box, *row]) for row_box, row in zip(boxes, sizes, strict=True)]
    labels = [[_label(cell, type_, width) for cell in row] for row in grid.rows]
    row_heads = [_inked(type_.wrapped([head], side * 3 // 5, HEAD_LINES)) for head in grid.row_heads]
    column_heads = [_inked(type_.wrapped([head], width, HEAD_LINES)) for head in grid.column_heads]
    gutter = max((round(type_.font.getlength(line)) for head in row_heads for line, _ in head), default=-type_.gap)
    xs = [2 * type_.gap + gutter + k * (width + type_.gap) for k in range(max(map(len, grid.rows)) + 1)]
    ys = [type_.gap + round((2.2 + max(map(len, column_heads), default=0)) * type_.line)]
    for height, row in zip(heights, labels, strict=True):
        ys.append(ys[-1] + height + round((max(map(len, row)) + 0.3) * type_.line) + type_.gap)
    return Layout(boxes, width, gutter, column_heads, row_heads, labels, heights, xs, ys)


def _label(cell: Cell, type_: Type, width: int) -> Lines:
    note = [(line, FAINT) for line in type_.wrapped(cell.note, width, 2)]
    return _inked(type_.wrapped(cell.label, width, LABEL_LINES - len(note))) + note


def _inked(lines: list[str]) -> Lines:
    return [(line, INK) for line in lines]


def _write(pen: ImageDraw.ImageDraw, type_: Type, lines: Lines, middle: int, top: int) -> None:
    for k, (text, color) in enumerate(lines):
        pen.text((middle, top + k * type_.line), text, color, type_.font, anchor="ma")


def _in_words(cell: Cell, size: Size, type_: Type) -> Image.Image:
    """A grey box that says why there is no picture."""
    box = Image.new("RGB", size, BOX)
    most = max(0, min(WORD_LINES, size[1] // type_.line - 2))
    words = cell.words or "the picture cannot be read"
    wrapped = type_.wrapped(words.split(), size[0] - type_.line, most, space=" ") if most else []
    lines = [(cell.alarm, ALARM)] * bool(cell.alarm) + _inked(wrapped)
    _write(ImageDraw.Draw(box), type_, lines, size[0] // 2, (size[1] - len(lines) * type_.line) // 2)
    return box


def _scaled_size(source: Path | Image.Image | None, side: int) -> Size | None:
    """Size on the sheet, from the head of the file; None if there is none or it cannot be read."""
    if source is None:
        return None
    try:
        with _opened(source) as picture:
            width, height = picture.size
    except UNREADABLE:
        return None
    zoom = side / max(width, height)
    zoom = int(zoom) if zoom > 1 else zoom  # small pictures show their pixels
    return max(1, round(width * zoom)), max(1, round(height * zoom))


def _opened(source: Path | Image.Image) -> AbstractContextManager[Image.Image]:
    return nullcontext(source) if isinstance(source, Image.Image) else Image.open(source)


def _scaled(source: Path | Image.Image | None, side: int) -> Image.Image | None:
    size = _scaled_size(source, side)
    if source is None or size is None:
        return None
    try:
        with _opened(source) as picture:
            method = Image.Resampling.NEAREST if size[0] > picture.width else Image.Resampling.BICUBIC
            return picture.convert("RGB").resize(size, method, reducing_gap=2.0)
    except UNREADABLE:
        return None
