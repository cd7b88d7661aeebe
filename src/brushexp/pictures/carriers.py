"""Read the colour encoding that a picture file declares: an ICC profile, standard code points, or a camera setting."""

import os
import struct
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import IO, Any

from PIL import Image

from brushexp.pictures.boxes import Property, properties_of_picture
from brushexp.pictures.colorimetry import (
    ADOBE_RGB,
    BT709,
    CURVES,
    SAME_WITHIN,
    SRGB,
    Encoding,
    decode_srgb,
    encoding_of,
    gamma,
    unless_srgb,
)

Colors = bytes | Encoding | None  # an ICC profile, an encoding, or None for sRGB or no declaration

IN_BOXES = ("AVIF", "HEIF")  # file formats that consist of boxes
HEAD = 2**20  # number of first bytes that may declare the colours of a file
WHITE_POINT, PRIMARY_CHROMATICITIES, SHOT, INTEROPERABILITY = 318, 319, 0x8769, 0xA005  # EXIF tags and sections
INTEROPERABILITY_INDEX, COLOR_SPACE, EXIF_GAMMA = 1, 0xA001, 0xA500
UNCALIBRATED, ADOBE = 65535, 2  # values of COLOR_SPACE
UNSPECIFIED = (0, 2)  # numbers of H.273 for unspecified colours
SRGB_GAMMA = 0.45455  # gamma of PNG files that mean sRGB
PROFILE_IN_FILE, PROFILE_OFFSET, QOI_SPACE = b"DEBM", 126, 13  # BMP: "MBED" backwards; byte offsets
ICC_METHODS = (b"\2", b"\3")  # values in a JPEG 2000 "colr" box that a profile follows


def colors_of(picture: Image.Image) -> Colors:
    """Determine a picture's colour encoding, before decoding, from the most authoritative declaration in its file."""
    head, profile = head_of(picture), picture.info.get("icc_profile")
    said: Colors = _of_png(head, picture) if picture.format == "PNG" else profile or _of_others(head, picture)
    if said is None:
        exif = exif_of(picture)
        with suppress(Exception):  # damaged EXIF data may raise nearly any error
            said = _of_exif(exif)
    return unless_srgb(said) if isinstance(said, Encoding) else said


def exif_of(picture: Image.Image) -> Image.Exif:
    """Read a picture's EXIF data; the result is empty if the data are damaged.

    The EXIF data of a PNG may follow its pixels, so Pillow has to decode the picture first. Errors from the decoder are
    propagated, because loading the picture again would yield black pixels.
    """
    if picture.format == "PNG" and "exif" not in picture.info:
        picture.load()
    with suppress(Exception):  # damaged data may raise nearly any error
        return picture.getexif()
    return Image.Exif()


@contextmanager
def place_kept(file: IO[bytes]) -> Iterator[None]:
    """Restore a file's read position at the end of the ``with`` block."""
    place = file.tell()
    try:
        yield
    finally:
        file.seek(place)


def head_of(picture: Image.Image) -> bytes:
    """Read the first bytes of a picture's file; return no bytes if the file is closed."""
    with suppress(AttributeError, OSError, ValueError):
        file: Any = picture.fp  # type: ignore[attr-defined]
        with place_kept(file):
            file.seek(0)
            head: bytes = file.read(HEAD)
            return head
    return b""


def properties_in_boxes(picture: Image.Image) -> list[Property]:
    """Read the properties that HEIF or AVIF boxes declare for the visible picture; return [] if the file is closed."""
    with suppress(AttributeError, OSError, ValueError):
        file: Any = picture.fp  # type: ignore[attr-defined]
        with place_kept(file):
            return properties_of_picture(file, file.seek(0, os.SEEK_END))
    return []


def _of_png(head: bytes, picture: Image.Image) -> Colors:
    """Read a PNG's colour encoding in the standard's order of precedence: cICP, iCCP, sRGB, gAMA with cHRM."""
    numbers = next((data for name, data in chunks_of(head) if name == b"cICP" and len(data) == 4), None)
    if numbers is not None:
        return encoding_of(numbers[0], numbers[1])
    info = picture.info
    if "icc_profile" in info or "srgb" in info:
        return info.get("icc_profile", SRGB)
    exponent, corners = info.get("gamma"), info.get("chromaticity")
    if not exponent and not corners:
        return None
    curve = gamma(1 / exponent) if exponent and abs(exponent - SRGB_GAMMA) > SAME_WITHIN else decode_srgb
    return Encoding(_pairs((*corners[2:], *corners[:2])) if corners and all(corners) else BT709, curve)


def chunks_of(png: bytes) -> Iterator[tuple[bytes, bytes]]:
    """Yield the name and data of each PNG chunk before the pixel data."""
    at = 8
    while at + 8 <= len(png) and png[at + 4 : at + 8] != b"IDAT":
        length = int.from_bytes(png[at : at + 4])
        yield png[at + 4 : at + 8], png[at + 8 : at + 8 + length]
        at += length + 12


def _of_others(head: bytes, picture: Image.Image) -> Colors:
    """Read the colour information that Pillow ignores in formats other than PNG."""
    if picture.format in IN_BOXES:
        said = next(
            (data for name, data in properties_in_boxes(picture) if name == b"colr" and data[:4] == b"nclx"), b""
        )
        primaries, transfer = struct.unpack(">HH", said[4:8].ljust(4, b"\0"))
        return encoding_of(primaries, transfer) if transfer not in UNSPECIFIED else None
    if picture.format == "JPEG2000":
        return _profile_in_jp2(head)
    if picture.format == "BMP" and head[70:74] == PROFILE_IN_FILE:
        offset, size = struct.unpack("<II", head[PROFILE_OFFSET : PROFILE_OFFSET + 8])
        return head[14 + offset : 14 + offset + size]
    if picture.format == "QOI" and head[QOI_SPACE : QOI_SPACE + 1] == b"\1":
        return Encoding(BT709, CURVES[8])
    return None


def _profile_in_jp2(head: bytes) -> bytes | None:
    before, found, box = head.partition(b"jp2c")[0].partition(b"colr")
    size = int.from_bytes(before[-4:]) - 8
    return box[3:size] if found and box[:1] in ICC_METHODS else None


def _of_exif(exif: Image.Exif) -> Encoding | None:
    """Read the camera's colour setting (Exif 2.32 and DCF 2.0), or the recorded primaries and white point."""
    shot = exif.get_ifd(SHOT)
    space, index = shot.get(COLOR_SPACE), str(exif.get_ifd(INTEROPERABILITY).get(INTEROPERABILITY_INDEX, ""))
    if space == ADOBE or (space in (UNCALIBRATED, None) and index.startswith("R03")):
        return ADOBE_RGB
    corners, white = exif.get(PRIMARY_CHROMATICITIES), exif.get(WHITE_POINT)
    if corners is None or white is None or space == 1:
        return None
    exponent = shot.get(EXIF_GAMMA)
    return Encoding(_pairs((*corners, *white)), gamma(float(exponent)) if exponent else decode_srgb)


def _pairs(numbers: tuple[float, ...]) -> tuple[tuple[float, float], ...]:
    """Group eight numbers into the chromaticities (x, y) of red, green, blue and white."""
    red, green, blue, white = ((float(x), float(y)) for x, y in zip(numbers[::2], numbers[1::2], strict=True))
    return red, green, blue, white
