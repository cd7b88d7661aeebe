"""Copy a picture's title, author, rights and date, but never its location, from its file to its painting."""

import io
import os
import re
from collections.abc import Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from PIL import Image, IptcImagePlugin, PngImagePlugin

from brushexp.pictures.carriers import SHOT
from brushexp.pictures.limits import open_of_any_size
from brushexp.system.files import PNG, write_bytes
from brushexp.system.published import catalogue_suffixes

KEYWORDS = ("Title", "Author", "Copyright", "Creation Time", "Description")  # PNG keywords
LONGEST_ENTRY, LARGEST_XMP = 2000, 2**20  # characters of an entry, bytes of a packet
EXIF = {"Author": 315, "Copyright": 33432, "Description": 270, "Title": 40091, "Creation Time": 306}  # TIFF tags
WIDE_TITLE, TAKEN = 40091, 36867  # tags: the title of Windows, in UTF-16, and the time when a photograph was taken
IPTC = {"Title": (2, 5), "Author": (2, 80), "Copyright": (2, 116), "Creation Time": (2, 55), "Description": (2, 120)}
XMP = {
    "Title": "{http://purl.org/dc/elements/1.1/}title",
    "Author": "{http://purl.org/dc/elements/1.1/}creator",
    "Copyright": "{http://purl.org/dc/elements/1.1/}rights",
    "Description": "{http://purl.org/dc/elements/1.1/}description",
    "Creation Time": "{http://ns.adobe.com/photoshop/1.0/}DateCreated",
}
SRGB = (b"sRGB", b"\0")  # PNG chunk


def credits_of(image: str) -> dict[str, str]:
    """Read a picture file's credits, by PNG keyword; the result is empty if the file has no readable credits.

    Text chunks of a PNG take precedence over XMP, EXIF and IPTC. The credits of a catalogue are read from the
    ``painting.png`` beside it.
    """
    found: dict[str, str] = {}
    path = Path(os.path.expanduser(image))
    path = path.with_name("painting.png") if path.suffix in catalogue_suffixes() else path
    if not os.path.isfile(path):
        return found
    with suppress(Exception), open_of_any_size(path) as picture:  # damaged parts are skipped
        for read in (_of_png, _of_xmp, _of_exif, _of_iptc):
            with suppress(Exception):
                found = {name: _plain(text) for name, text in read(picture).items() if _plain(text)} | found
    return {name: found[name] for name in KEYWORDS if name in found}


def chunks_about(entries: Mapping[str, str]) -> Iterator[tuple[bytes, bytes]]:
    """Yield the names and data of PNG chunks: an sRGB declaration, and the credits ``entries`` as text and as EXIF."""
    yield SRGB
    for name, text in entries.items():
        yield b"iTXt", name.encode() + b"\0\0\0\0\0" + text.encode("utf-8", "replace")
    exif = Image.Exif()
    for name, tag in EXIF.items():
        if name in entries and tag != WIDE_TITLE:
            exif[tag] = entries[name]
    if len(exif):
        yield b"eXIf", exif.tobytes().removeprefix(b"Exif\0\0")


def write_credited(path: Path, pixels: np.ndarray, entries: Mapping[str, str]) -> None:
    """Write uint8 pixels (H, W, 3 or 4) as an sRGB PNG with the credits ``entries`` from `credits_of`."""
    about, encoded = PngImagePlugin.PngInfo(), io.BytesIO()
    options: dict[str, Any] = {"pnginfo": about, **PNG}
    for name, data in chunks_about(entries):
        if name == b"eXIf":
            options["exif"] = data
        else:
            about.add(name, data)
    Image.fromarray(pixels).save(encoded, **options)
    write_bytes(path, encoded.getvalue())


def _of_png(picture: Image.Image) -> dict[str, Any]:
    return {name: picture.info.get(name) for name in KEYWORDS} if picture.format == "PNG" else {}


def _of_exif(picture: Image.Image) -> dict[str, Any]:
    exif = picture.getexif()
    found: dict[str, Any] = {name: exif.get(tag) for name, tag in EXIF.items()}
    if isinstance(title := found["Title"], bytes):
        found["Title"] = title.decode("utf-16-le", "ignore")
    return found | {"Creation Time": exif.get_ifd(SHOT).get(TAKEN) or found["Creation Time"]}


def _of_iptc(picture: Any) -> dict[str, Any]:
    entries: Any = IptcImagePlugin.getiptcinfo(picture) or {}
    return {name: entries.get(key) for name, key in IPTC.items()}


def _of_xmp(picture: Image.Image) -> dict[str, Any]:
    packet = picture.info.get("xmp") or picture.info.get("XML:com.adobe.xmp") or b""
    packet = packet.encode() if isinstance(packet, str) else packet
    if len(packet) > LARGEST_XMP or re.search(rb"<!(DOCTYPE|ENTITY)", packet):
        return {}
    start = packet.find(b"<x:xmpmeta")
    tree = ElementTree.fromstring(packet[max(start, 0) :].rstrip(b"\0").partition(b"<?xpacket end")[0])
    found: dict[str, Any] = {}
    for name, tag in XMP.items():
        places = [*tree.iter(tag)]
        words = [word.strip() for node in places for word in node.itertext() if word.strip()]
        given = [node.attrib[tag] for node in tree.iter() if tag in node.attrib]
        found[name] = ", ".join(words if name == "Author" else words[:1]) or next(iter(given), None)
    return found


def _plain(text: Any) -> str:
    """Convert text, a list or bytes to one line of printable text, and any other value to an empty string."""
    if isinstance(text, list | tuple):
        return ", ".join(filter(None, map(_plain, text)))[:LONGEST_ENTRY]
    if isinstance(text, bytes):
        try:
            text = text.decode()
        except UnicodeDecodeError:
            text = text.decode("latin-1")
    if not isinstance(text, str):
        return ""
    return " ".join("".join(c if c.isprintable() else " " for c in text).split())[:LONGEST_ENTRY]
