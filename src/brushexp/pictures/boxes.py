"""Read the boxes of a file (ISO/IEC 14496-12) and the picture properties declared in them (ISO/IEC 23008-12)."""

import math
import struct
from collections.abc import Iterator
from fractions import Fraction
from typing import IO

SHORTEST_BOX = 8  # bytes of the length and name of a box
MOST_BOXES = 1000  # maximum number of boxes read on one level
LARGEST_BOX = 2**24  # bytes of the largest box that is read into memory
FULL_BOX = 4  # bytes of version and flags, which precede the contents of some boxes
VISUAL_SAMPLE = 78  # bytes of a description of pictures that precede its boxes
TO_SAMPLES = (b"mdia", b"minf", b"stbl")  # nested boxes, from a track to the table of its pictures
PICTURES, VIDEO = b"pict", b"vide"  # kinds of tracks
APERTURE = struct.Struct(">IIIIiIiI")  # fractions: width, height, and offset of the middle to the right and downwards
Crop = tuple[slice, slice]  # visible rows and columns of a picture
Property = tuple[bytes, bytes]  # name and contents of a box


def boxes(file: IO[bytes], size: int) -> Iterator[tuple[bytes, int | None]]:
    """Yield the name and end of each box in a file of ``size`` bytes; the end is None if the box does not state it."""
    for name, _, end in _places(file, size):
        yield name, end


def _places(file: IO[bytes], size: int) -> Iterator[tuple[bytes, int, int | None]]:
    """Yield the name, the start of the contents, and the end of each box in a file."""
    at = 0
    for _ in range(MOST_BOXES):
        if at >= size:
            return
        file.seek(at)
        head = file.read(16)
        length, begin = int.from_bytes(head[:4]), at + 8
        if length == 1:
            length, begin = int.from_bytes(head[8:]), at + 16
        known = length >= SHORTEST_BOX
        yield head[4:8], begin, at + length if known else None
        if not known:
            return
        at += length


def properties_of_picture(file: IO[bytes], size: int) -> list[Property]:
    """List the properties that a HEIF or AVIF file declares for its visible picture, in the order in which they apply.

    The picture is the primary item or, in an animated file (brand ``avis``), the picture track.
    """
    found = _read_boxes(file, size, (b"ftyp", b"meta", b"moov"))
    of_track = _of_track(found.get(b"moov", b""), PICTURES) if found.get(b"ftyp", b"")[:4] == b"avis" else []
    return of_track or _of_primary_item(found.get(b"meta", b"")[FULL_BOX:])


def properties_of_film(file: IO[bytes], size: int) -> list[Property]:
    """List the properties that an MP4 or QuickTime file declares for its first video track."""
    return _of_track(_read_boxes(file, size, (b"moov",)).get(b"moov", b""), VIDEO)


def clean_aperture_in(properties: list[Property], width: int, height: int) -> Crop | None:
    """Compute a picture's visible rows and columns from its ``clap`` box (ISO/IEC 14496-12, 12.1.4).

    Returns None if the box is missing or extends beyond the ``width`` and ``height`` of the picture.
    """
    said = next((contents for name, contents in properties if name == b"clap"), b"")
    if len(said) < APERTURE.size:
        return None
    wide, wide_in, high, high_in, right, right_in, low, low_in = APERTURE.unpack_from(said)
    try:
        columns = _span(width, Fraction(wide, wide_in), Fraction(right, right_in))
        rows = _span(height, Fraction(high, high_in), Fraction(low, low_in))
    except ZeroDivisionError:
        return None
    return None if columns is None or rows is None else (rows, columns)


def _span(side: int, length: Fraction, offset: Fraction) -> slice | None:
    """Compute the visible pixels along a side, for an aperture whose centre is ``offset`` from the picture's centre."""
    first, count = math.floor((side - length) / 2 + offset), round(length)
    return slice(first, first + count) if count > 0 and 0 <= first <= side - count else None


def _read_boxes(file: IO[bytes], size: int, names: tuple[bytes, ...]) -> dict[bytes, bytes]:
    """Read the contents of the first box with each of the given names."""
    found: dict[bytes, bytes] = {}
    for name, begin, end in _places(file, size):
        if name in names and name not in found:
            file.seek(begin)
            found[name] = file.read(min((size if end is None else end) - begin, LARGEST_BOX))
    return found


def _parts(data: bytes) -> Iterator[Property]:
    """Yield the name and contents of each box in a block of memory."""
    at = 0
    for _ in range(MOST_BOXES):
        length = int.from_bytes(data[at : at + 4])
        begin = 8
        if length == 1:
            length, begin = int.from_bytes(data[at + 8 : at + 16]), 16
        if at + SHORTEST_BOX > len(data) or length < SHORTEST_BOX:
            return
        yield data[at + 4 : at + 8], data[at + begin : at + length]
        at += length


def _part(data: bytes, *names: bytes) -> bytes:
    """Return the contents of the nested box at a path of ``names``, or empty bytes if there is no such box."""
    for name in names:
        data = next((contents for other, contents in _parts(data) if other == name), b"")
    return data


def _of_track(movie: bytes, wanted: bytes) -> list[Property]:
    """List the properties in the sample description of the first track of a given kind."""
    for name, track in _parts(movie):
        kind = _part(track, b"mdia", b"hdlr")[FULL_BOX + 4 :][:4]
        if name == b"trak" and kind == wanted:
            table = _part(track, *TO_SAMPLES, b"stsd")[FULL_BOX + 4 :]
            return [part for _, entry in [*_parts(table)][:1] for part in _parts(entry[VISUAL_SAMPLE:])]
    return []


def _of_primary_item(meta: bytes) -> list[Property]:
    """List the properties associated with the primary item."""
    chosen = _part(meta, b"pitm")
    number = int.from_bytes(chosen[FULL_BOX : FULL_BOX + (4 if chosen[:1] > b"\0" else 2)])
    known = [*_parts(_part(meta, b"iprp", b"ipco"))]
    found: dict[int, list[int]] = {}
    for name, links in _parts(_part(meta, b"iprp")):
        if name == b"ipma":
            found |= _associations(links)
    return [known[index - 1] for index in found.get(number, []) if 0 < index <= len(known)]


def _associations(links: bytes) -> dict[int, list[int]]:
    """Read the indices, counted from 1, of each item's properties (ISO/IEC 23008-12, 9.3.1)."""
    of_item = 4 if links[:1] > b"\0" else 2  # bytes of an item's number
    wide = links[3:4] != b"" and bool(links[3] & 1)
    found: dict[int, list[int]] = {}
    at = FULL_BOX + 4
    for _ in range(min(int.from_bytes(links[FULL_BOX:at]), len(links))):
        number, count = int.from_bytes(links[at : at + of_item]), int.from_bytes(links[at + of_item :][:1])
        at += of_item + 1
        step = 2 if wide else 1
        bits = 0x7FFF if wide else 0x7F  # excludes the bit that marks a property as essential
        found[number] = [int.from_bytes(links[at + step * k :][:step]) & bits for k in range(count)]
        at += step * count
    return found
