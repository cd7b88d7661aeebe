"""Read Photoshop brush sets (.abr) of version 1, version 2, and version 6 and later.

Adobe has not published a specification of these files; the layout was taken from the readers in GIMP
(app/core/gimpbrush-load.c) and Krita (libs/brush/kis_abr_brush_collection.cpp). Numbers are big-endian. Brushes defined
by formulas (*computed* brushes) contain no picture and are skipped.
"""

import struct
from collections.abc import Iterator

import numpy as np

from brushexp.contracts import UserError
from brushexp_media.brushes.gimp import LARGEST_SIDE, Stamp

OLD_VERSIONS = (1, 2)
FIRST_IN_SECTIONS = 6  # first version in which a file consists of sections, like a .psd
SAMPLED = 2  # type of a brush with a picture, in old versions
UNNAMED, NAMED = 1, 2  # old versions in which brushes are unnamed and named
KEY = 37  # bytes of the key of a brush in a section
BEFORE_BOUNDS = {1: KEY + 10, 2: KEY + 264}  # bytes of a brush before its bounds, by minor version
SPACING = 0.25  # default where a file does not store the spacing with the brush
Samples = np.dtype[np.uint8] | np.dtype[np.uint16]
DEPTHS: dict[int, tuple[Samples, int]] = {  # bits per pixel -> dtype, and value of full coverage
    8: (np.dtype("u1"), 255),
    16: (np.dtype(">u2"), 65535),
}
CURE = "save the set anew from Photoshop, or its brushes from GIMP or Krita as .gbr or PNG"


class _Damage(Exception):
    """Error for a brush that is truncated or has an invalid value."""


class _Bytes:
    """A reader of consecutive numbers in a byte string."""

    def __init__(self, data: bytes) -> None:
        self.data = data
        self.at = 0

    def take(self, count: int) -> bytes:
        if count < 0 or self.at + count > len(self.data):
            raise _Damage("it ends too early")
        part = self.data[self.at : self.at + count]
        self.at += count
        return part

    def number(self, kind: str) -> int:
        """Read a number of 1 byte (``b``), 2 bytes (``h``) or 4 bytes (``i``); upper case means unsigned."""
        return int(struct.unpack(f">{kind}", self.take(struct.calcsize(f">{kind}")))[0])

    @property
    def left(self) -> int:
        return len(self.data) - self.at


def read_abr(data: bytes) -> list[Stamp]:
    """Read all sampled brushes of an .abr file; raise a UserError that says what is wrong."""
    file = _Bytes(data)
    try:
        version, minor = file.number("H"), file.number("H")
        if version in OLD_VERSIONS:
            stamps = list(_old_brushes(file, version, minor))
        elif version >= FIRST_IN_SECTIONS and minor in BEFORE_BOUNDS:
            stamps = [_picture(brush, BEFORE_BOUNDS[minor], SPACING) for brush in _brushes_of_sections(file)]
        else:
            raise UserError(f"is no set of brushes of Photoshop that can be read (version {version}.{minor}); {CURE}")
    except _Damage as damage:
        raise UserError(f"is damaged: {damage}; {CURE}") from damage
    if not stamps:
        raise UserError("has no brush with a picture; paint a stroke with it and save that as PNG")
    return stamps


def _old_brushes(file: _Bytes, version: int, count: int) -> Iterator[Stamp]:
    """Yield the ``count`` sampled or computed brushes of a file of version 1 or 2, skipping the computed ones."""
    for _ in range(count):
        kind = file.number("H")
        brush = _Bytes(file.take(file.number("I")))
        if kind != SAMPLED:
            continue
        brush.take(4)  # unused
        percent = brush.number("H")
        if version == NAMED:
            brush.take(2 * brush.number("I"))  # the name, with two bytes per letter
        brush.take(1 + 8)  # antialiasing flag, and bounds as short integers
        yield _picture(brush, 0, min(max(percent, 1), 1000) / 100)


def _brushes_of_sections(file: _Bytes) -> Iterator[_Bytes]:
    """Yield the brushes in all ``samp`` sections; each brush starts at a multiple of four bytes within its section."""
    while file.left >= 12:
        if file.take(4) != b"8BIM":
            raise _Damage("a section does not begin where it should")
        name, section = file.take(4), _Bytes(file.take(file.number("I")))
        while name == b"samp" and section.left >= 4:
            size = section.number("I")
            yield _Bytes(section.take(size))
            section.take(min(-size % 4, section.left))


def _picture(brush: _Bytes, before: int, spacing: float) -> Stamp:
    """Skip ``before`` bytes of a brush, and read its bounds and its picture."""
    brush.take(before)
    top, left, bottom, right = (brush.number("i") for _ in range(4))
    height, width, depth, is_packed = bottom - top, right - left, brush.number("H"), brush.number("B")
    if not (0 < height <= LARGEST_SIDE and 0 < width <= LARGEST_SIDE):
        raise _Damage(f"a brush has {width} x {height} pixels, and those of 1 to {LARGEST_SIDE} a side are read")
    if depth not in DEPTHS or is_packed not in (0, 1):
        raise _Damage(f"a brush has {depth} bits a pixel, packed as {is_packed}")
    kind, full = DEPTHS[depth]
    row = width * kind.itemsize
    if is_packed:
        sizes = [brush.number("H") for _ in range(height)]
        pixels = b"".join(_unpack(brush.take(size), row) for size in sizes)
    else:
        pixels = brush.take(height * row)
    return Stamp(np.frombuffer(pixels, kind).reshape(height, width).astype(np.float32) / full, spacing)


def _unpack(packed: bytes, length: int) -> bytes:
    """Unpack PackBits data to ``length`` bytes.

    A number n >= 0 precedes n + 1 literal bytes; a number n < 0 precedes one byte, to be repeated 1 - n times.
    """
    source, row = _Bytes(packed), b""
    while source.left and len(row) < length:
        count = source.number("b")
        if count >= 0:
            row += source.take(count + 1)
        elif count > -128:
            row += source.take(1) * (1 - count)
    if len(row) != length:
        raise _Damage("a row of a brush has not as many pixels as it should")
    return row
