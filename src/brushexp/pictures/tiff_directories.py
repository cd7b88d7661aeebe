"""Walk the directories of a TIFF file (TIFF 6.0; BigTIFF), visiting each only once, because links may form cycles."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import IO

MOST_DIRECTORIES = 10_000  # maximum number of directories read in a file
MOST_TAGS = 4096  # maximum number of tags in a directory
MOST_VALUES = 2**22  # maximum number of values of a tag, such as the offsets of strips
WHOLE_NUMBERS = {1: "B", 3: "H", 4: "I", 13: "I", 16: "Q", 18: "Q"}  # types of values -> format characters of `struct`
SUBFILE, SUB_IFDS = 254, 330  # tags
JPEG_TABLES, BYTES = 347, "B"  # a tag of undefined type, and its actual type
STRIPS, STRIP_BYTES, TILE_WIDTH, TILES, TILE_BYTES = 273, 279, 322, 324, 325
REDUCED = 1  # bit of SUBFILE: a smaller copy of another picture of the file
OLD_SUBFILE, OLD_REDUCED = 255, 2  # the same before TIFF 6.0
WIDTH, LENGTH, BITS, COMPRESSION, PHOTOMETRIC = 256, 257, 258, 259, 262
FILL_ORDER, LAST_BIT_FIRST = 266, 2  # a tag, and its value if bytes begin with their last bit
MAGIC = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")
BIG = b"+"  # third or fourth byte of a BigTIFF


@dataclass(frozen=True)
class Directory:
    """A TIFF directory, which describes a single picture in the file."""

    place: int  # offset in the file
    numbers: dict[int, tuple[int, ...]]  # tag -> its integers

    def number(self, tag: int) -> int:
        """Return the first integer of a tag, or 0."""
        return self.numbers.get(tag, (0,))[0]

    @property
    def is_reduced(self) -> bool:
        """Return whether the picture is a smaller copy of another one."""
        return bool(self.number(SUBFILE) & REDUCED) or self.number(OLD_SUBFILE) == OLD_REDUCED

    @property
    def mixes_tiles_with_strips(self) -> bool:
        """Return whether tile offsets are stored under the tag for strips or strip offsets under the tag for tiles."""
        is_tiled = TILE_WIDTH in self.numbers
        return (TILES if is_tiled else STRIPS) not in self.numbers and (STRIPS if is_tiled else TILES) in self.numbers

    def pieces(self) -> list[tuple[int, int]]:
        """List the offsets and lengths of all strips or tiles; empty if the directory does not state them."""
        places = self.numbers.get(TILES) or self.numbers.get(STRIPS) or ()
        lengths = self.numbers.get(TILE_BYTES) or self.numbers.get(STRIP_BYTES) or ()
        return [*zip(places, lengths, strict=True)] if len(places) == len(lengths) else []

    def end_of_data(self) -> int | None:
        """Return the byte offset of the end of the last strip or tile; None if the directory does not state it."""
        return max((place + length for place, length in self.pieces()), default=None)


def directories(path: Path) -> Iterator[Directory]:
    """Yield the directories of a file in order, and stop at the first that is damaged or has been visited before."""
    with path.open("rb") as file:
        head = file.read(16)
        order = "<" if head[:1] == b"I" else ">"
        is_big = BIG in head[2:4]
        (at,) = struct.unpack(order + "Q", head[8:]) if is_big else struct.unpack(order + "I", head[4:8])
        places: set[int] = set()
        while at and at not in places and len(places) < MOST_DIRECTORIES:
            places.add(at)
            read = _directory(file, at, order, is_big)
            if read is None:
                return
            directory, at = read
            yield directory


def directory_at(path: Path, place: int) -> Directory | None:
    """Read the directory at an offset of a file; None if it is damaged."""
    with path.open("rb") as file:
        head = file.read(4)
        read = _directory(file, place, "<" if head[:1] == b"I" else ">", BIG in head[2:4])
    return None if read is None else read[0]


def directories_below(path: Path, directory: Directory) -> Iterator[Directory]:
    """Yield the subdirectories of a directory, which describe other versions of its picture."""
    for place in dict.fromkeys(directory.numbers.get(SUB_IFDS, ())):
        if (found := directory_at(path, place)) is not None:
            yield found


def main_directory(path: Path) -> Directory | None:
    """Find the directory of the main picture: the first that is not a smaller copy or, if all are, the largest."""
    first = first_directory(path)
    if first is None or not first.is_reduced:
        return first
    pages = [page for top in directories(path) for page in (top, *directories_below(path, top))]
    whole = [page for page in pages if not page.is_reduced]
    return whole[0] if whole else max(pages, key=lambda page: page.number(WIDTH) * page.number(LENGTH))


def first_directory(path: Path) -> Directory | None:
    """Read the directory of a file's first picture; None if it is damaged or the file is not a TIFF."""
    with path.open("rb") as file:
        is_tiff = file.read(4) in MAGIC
    try:
        return next(directories(path), None) if is_tiff else None
    except struct.error:  # the file has only a few bytes
        return None


def _directory(file: IO[bytes], place: int, order: str, is_big: bool) -> tuple[Directory, int] | None:
    """Read a directory and the offset of the next directory."""
    count_form, entry, next_form = ("Q", struct.Struct(order + "HHQ8s"), "Q") if is_big else (
        "H", struct.Struct(order + "HHI4s"), "I"
    )  # fmt: skip
    try:
        file.seek(place)
        (count,) = struct.unpack(order + count_form, file.read(struct.calcsize(count_form)))
        rows = file.read(entry.size * min(count, MOST_TAGS))
        if len(rows) < entry.size * min(count, MOST_TAGS):
            return None
        numbers = {}
        for tag, kind, length, value in entry.iter_unpack(rows):
            form = BYTES if tag == JPEG_TABLES else WHOLE_NUMBERS.get(kind)
            numbers[tag] = _numbers(file, order, form, length, value)
        file.seek(place + struct.calcsize(order + count_form) + entry.size * count)
        rest = file.read(struct.calcsize(next_form))
        following = struct.unpack(order + next_form, rest)[0] if len(rest) == struct.calcsize(next_form) else 0
    except (struct.error, OSError, OverflowError, ValueError):
        return None
    return Directory(place, {tag: found for tag, found in numbers.items() if found}), following


def _numbers(file: IO[bytes], order: str, form: str | None, length: int, value: bytes) -> tuple[int, ...]:
    """Read a tag's integers from its entry, or from the offset in the entry; empty if the tag has another type."""
    if form is None or not 0 < length <= MOST_VALUES:
        return ()
    whole = struct.Struct(f"{order}{length}{form}")
    if whole.size > len(value):
        place = int.from_bytes(value, "little" if order == "<" else "big")
        file.seek(place)
        value = file.read(whole.size)
        if len(value) < whole.size:
            return ()
    numbers: tuple[int, ...] = whole.unpack_from(value)
    return numbers
