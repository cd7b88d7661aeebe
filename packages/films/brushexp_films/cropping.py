"""Find the part of the picture that a film's container marks as visible; FFmpeg leaves cropping to players."""

from collections.abc import Iterator
from pathlib import Path
from typing import IO

from brushexp.contracts.pictures import Crop, clean_aperture_in, properties_of_film

SEGMENT, TRACKS, TRACK, VIDEO, CLUSTER = 0x18538067, 0x1654AE6B, 0xAE, 0xE0, 0x1F43B675  # elements of Matroska
MARGINS = {0x54BB: "top", 0x54AA: "bottom", 0x54CC: "left", 0x54DD: "right"}  # cropped pixels (RFC 9559)
MATROSKA = b"\x1aE\xdf\xa3"  # first bytes of a Matroska file
LONGEST_ID, LONGEST_NUMBER = 4, 8  # bytes
MOST_ELEMENTS = 1000  # maximum number of elements read per level


def crop_of(path: Path, height: int, width: int) -> Crop | None:
    """Find the visible rows and columns in a film's first video, given its picture size; None if all are visible."""
    size = path.stat().st_size
    with path.open("rb") as file:
        is_matroska = file.read(len(MATROSKA)) == MATROSKA
        if not is_matroska:
            return clean_aperture_in(properties_of_film(file, size), width, height)
        margins = _margins(file, size)
    rows = slice(margins.get("top", 0), height - margins.get("bottom", 0))
    columns = slice(margins.get("left", 0), width - margins.get("right", 0))
    return (rows, columns) if margins and rows.start < rows.stop and columns.start < columns.stop else None


def _margins(file: IO[bytes], size: int) -> dict[str, int]:
    """Read how many pixels are cropped on each side of the first video in a Matroska file."""
    for segment, begin, end in _elements(file, 0, size):
        if segment != SEGMENT:
            continue
        for name, first, last in _elements(file, begin, end):
            if name == CLUSTER:
                break
            tracks = _elements(file, first, last) if name == TRACKS else ()
            for _, inner, outer in [place for place in tracks if place[0] == TRACK]:
                for kind, start, stop in _elements(file, inner, outer):
                    if kind == VIDEO:
                        return _numbers(file, start, stop)
    return {}


def _numbers(file: IO[bytes], begin: int, end: int) -> dict[str, int]:
    found = {}
    for name, first, last in _elements(file, begin, end):
        if name in MARGINS and last - first <= LONGEST_NUMBER:
            file.seek(first)
            found[MARGINS[name]] = int.from_bytes(file.read(last - first))
    return {side: count for side, count in found.items() if count}


def _elements(file: IO[bytes], begin: int, end: int) -> Iterator[tuple[int, int, int]]:
    """Yield, for each EBML element (RFC 8794) in a byte range, its identifier and the start and end of its content."""
    at = begin
    for _ in range(MOST_ELEMENTS):
        if at >= end:
            return
        file.seek(at)
        head = file.read(LONGEST_ID + LONGEST_NUMBER)
        name, name_bytes = _number(head, keeps_mark=True)
        length, length_bytes = _number(head[name_bytes:], keeps_mark=False)
        if not name_bytes or not length_bytes:
            return
        first = at + name_bytes + length_bytes
        is_unknown = length == (1 << 7 * length_bytes) - 1
        at = end if is_unknown else min(first + length, end)
        yield name, first, at


def _number(data: bytes, *, keeps_mark: bool) -> tuple[int, int]:
    """Parse a variable-length integer; return its value and its length in bytes, which is 0 if there is no integer."""
    count = 9 - data[0].bit_length() if data and data[0] else 0
    if not count or count > len(data):
        return 0, 0
    number = int.from_bytes(data[:count])
    return (number if keeps_mark else number & ((1 << 7 * count) - 1)), count
