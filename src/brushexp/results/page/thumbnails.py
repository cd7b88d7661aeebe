"""Pictures small enough to be many on a page; each is encoded once in the life of a process."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from PIL import Image

from brushexp.results.page.html import data_uri, downscaled
from brushexp.results.runs import UNREADABLE

AREA = 16_000_000  # pixels: of all pictures of a page together
SIDES = (640, 452, 320, 226, 160, 113, 80)  # pixels: each half the area of the one before
QUALITY = 80  # of WebP
KEPT = 4096  # pictures: more than a page holds at its smallest side, so memory stays below some pages


@dataclass(frozen=True)
class Thumbnail:
    """A picture that a page holds: its address there, and its size in pixels."""

    src: str
    width: int
    height: int


def side_for(count: int) -> int:
    """Longer side in pixels of each of so many pictures: the largest with which all of them keep to ``AREA``."""
    return next((side for side in SIDES if count * side**2 <= AREA), SIDES[-1])


def thumbnail(path: Path, side: int) -> Thumbnail | None:
    """A picture no larger than this, never enlarged; None if there is none or it cannot be read."""
    try:
        found = path.stat()
        return _encoded(path.resolve(), found.st_mtime_ns, found.st_size, side)
    except UNREADABLE:
        return None


@lru_cache(KEPT)
def _encoded(path: Path, changed: int, size: int, side: int) -> Thumbnail:
    """The same; ``changed`` and ``size`` tell one state of the file from another."""
    with Image.open(path) as opened:
        picture = downscaled(opened.convert("RGB"), side)
    src = data_uri(picture, "WEBP", quality=QUALITY, method=2)  # half the time of 4, a twentieth more bytes
    return Thumbnail(src, *picture.size)
