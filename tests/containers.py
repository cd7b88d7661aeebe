"""Helpers that add picture properties, such as crops, to files made of boxes (ISO/IEC 14496-12)."""

import struct
from collections.abc import Iterable, Sequence

Box = tuple[bytes, bytes]  # name and contents
TO_ENTRY = (
    (b"moov", 0),
    (b"trak", 0),
    (b"mdia", 0),
    (b"minf", 0),
    (b"stbl", 0),
    (b"stsd", 8),
)  # names of boxes, and the number of bytes before their inner boxes


def packed(name: bytes, contents: bytes) -> bytes:
    return struct.pack(">I4s", 8 + len(contents), name) + contents


def clap(width: int, height: int, right: int, low: int, parts: int = 2) -> Box:
    """Make a crop box whose centre is offset from the picture's centre.

    The offset is ``right / parts`` pixels to the right and ``low / parts`` pixels down.
    """
    return b"clap", struct.pack(">IIIIiIiI", width, 1, height, 1, right, parts, low, parts)


def place_of(data: bytes, path: Iterable[tuple[bytes, int]]) -> list[tuple[int, int]]:
    """Return the position and length of each box on a path of nested boxes."""
    begin, end, places = 0, len(data), []
    for name, before in path:
        at = begin
        while data[at + 4 : at + 8] != name:
            at += int.from_bytes(data[at : at + 4])
            assert at < end, name
        length = int.from_bytes(data[at : at + 4])
        places.append((at, length))
        begin, end = at + 8 + before, at + length
    return places


def inserted(data: bytes, path: Sequence[tuple[bytes, int]], extra: bytes) -> bytes:
    """Insert bytes at the end of the last box on a path, and update the lengths of all boxes on the path."""
    places = place_of(data, path)
    whole = bytearray(data)
    end = sum(places[-1])
    whole[end:end] = extra
    for at, length in places:
        whole[at : at + 4] = (length + len(extra)).to_bytes(4)
    return bytes(whole)


def film_with(data: bytes, entry: bytes, properties: Sequence[Box]) -> bytes:
    """Add picture properties to the sample ``entry`` of a film's first track."""
    extra = b"".join(packed(*one) for one in properties)
    is_first = data.index(b"moov") < data.index(b"mdat")
    whole = bytearray(inserted(data, [*TO_ENTRY, (entry, 78)], extra))
    places = place_of(whole, [*TO_ENTRY[:-1], (b"stco", 0)])[-1][0] if is_first else None
    for k in range(0 if places is None else int.from_bytes(whole[places + 12 : places + 16])):
        at = places + 16 + 4 * k
        whole[at : at + 4] = (int.from_bytes(whole[at : at + 4]) + len(extra)).to_bytes(4)
    return bytes(whole)


def picture_with(data: bytes, properties: Sequence[Box]) -> bytes:
    """Add properties to the only item of a HEIF or AVIF file."""
    meta, iprp = (b"meta", 4), (b"iprp", 0)
    before = place_of(data, [meta])[0][1]
    (at, length) = place_of(data, [meta, iprp, (b"ipco", 0)])[-1]
    known, place = 0, at + 8
    while place < at + length:
        place += int.from_bytes(data[place : place + 4])
        known += 1
    data = inserted(data, [meta, iprp, (b"ipco", 0)], b"".join(packed(*one) for one in properties))
    numbers = bytes(0x80 | (known + 1 + k) for k in range(len(properties)))
    data = inserted(data, [meta, iprp, (b"ipma", 4)], numbers)
    (at, _) = place_of(data, [meta, iprp, (b"ipma", 4)])[-1]
    whole = bytearray(data)
    assert whole[at + 8] == 0  # item numbers have two bytes
    assert int.from_bytes(whole[at + 12 : at + 16]) == 1
    whole[at + 18] += len(properties)  # of the only item
    growth = place_of(whole, [meta])[0][1] - before
    return moved(bytes(whole), growth)


def moved(data: bytes, growth: int) -> bytes:
    """Add ``growth`` to the position of the item's data, which ``iloc`` stores as four bytes."""
    (at, _) = place_of(data, [(b"meta", 4), (b"iloc", 4)])[-1]
    whole = bytearray(data)
    version, sizes = whole[at + 8], whole[at + 12]
    assert (version, sizes) in ((0, 0x44), (1, 0x44)), (version, sizes)
    base = whole[at + 13] >> 4
    place = at + 16 + 2 + (2 if version == 1 else 0) + 2 + base + 2
    whole[place : place + 4] = (int.from_bytes(whole[place : place + 4]) + growth).to_bytes(4)
    return bytes(whole)
