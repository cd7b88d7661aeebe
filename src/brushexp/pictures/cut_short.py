"""Decode truncated picture files as far as possible, and reject files that lack too much of the picture."""

import io
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

import numpy as np
from PIL import Image, ImageFile

from brushexp.errors import UserError
from brushexp.pictures.boxes import MOST_BOXES, boxes
from brushexp.pictures.tiff_directories import MAGIC, first_directory

SOME_MISSING = "is truncated: the file ends before the picture does; get the whole file"
END_OF_JPEG = b"\xff\xd9"
LAST_MARKS = {  # first bytes of a file -> the mark at its end, and the mark that must last occur before it
    b"\xff\xd8": (END_OF_JPEG, b"\xff\xda"),  # a thumbnail has its own end, before the picture begins
    b"\xff\x4f\xff\x51": (END_OF_JPEG, b"\xff\x93"),
    b"\0\0\0\x0cjP  ": (END_OF_JPEG, b"\xff\x93"),
    b"\x89PNG": (b"IEND", b"IDAT"),
}
LAST_BYTES = {b"GIF8": b";", b"qoif": b"\0\0\0\0\0\0\0\1"}
BOXES = (b"ftyp", b"jP  ", b"JXL ")  # fifth to eighth byte of files that consist of boxes (ISO/IEC 14496-12)
TAIL = 2**16  # number of last bytes to search for the end marker; some programs append other data
JPEGS = ("JPEG", "MPO")
ROW_BY_ROW = (*JPEGS, "PNG", "TIFF", "BMP", "DIB", "TGA", "PPM")  # formats whose decoders return the existing part
MOST_MISSING = 0.05  # largest share of missing pixels in a picture that is still painted
JPEG_FILL = 128  # grey level of the missing part of a JPEG; 0 in other formats


def has_end(path: Path) -> bool | None:
    """Check whether a picture's file is complete; return None if this cannot be determined."""
    size = path.stat().st_size
    with path.open("rb") as file:
        head = file.read(16)
        if head[:4] == b"RIFF":
            return size >= 8 + int.from_bytes(head[4:8], "little")
        if head[:4] in MAGIC:
            return _tiff_fits(path, size)
        if head[4:8] in BOXES and (fit := _boxes_fit(file, size)) is not None:
            return fit
        file.seek(max(0, size - TAIL))
        tail = file.read()
    for start, (last, before) in LAST_MARKS.items():
        if head.startswith(start):
            return tail.rfind(last) > tail.rfind(before)
    return next((tail.endswith(end) for start, end in LAST_BYTES.items() if head.startswith(start)), None)


def _tiff_fits(path: Path, size: int) -> bool | None:
    """Check whether a TIFF file contains all its strips or tiles; return None if it does not state their lengths."""
    first = first_directory(path)
    end = None if first is None else first.end_of_data()
    return False if first is None else None if end is None else end <= size


def _boxes_fit(file: IO[bytes], size: int) -> bool | None:
    """Check whether the last box of a file ends where the file does; return None if this cannot be determined."""
    ends = [end for _, end in boxes(file, size)]
    end = ends[-1] if len(ends) < MOST_BOXES else None
    return None if end is None or end < size else end == size


def open_truncated(path: Path, kind: str) -> ImageFile.ImageFile | None:
    """Reopen a truncated picture to decode its beginning; return None if it is complete or cannot be decoded."""
    if kind not in ROW_BY_ROW or has_end(path):
        return None
    return Image.open(io.BytesIO(path.read_bytes() + (END_OF_JPEG if kind in JPEGS else b"")))


@contextmanager
def allow_truncated() -> Iterator[None]:
    """Let Pillow decode truncated files as far as possible within the ``with`` block."""
    ImageFile.LOAD_TRUNCATED_IMAGES = True
    try:
        yield
    finally:
        ImageFile.LOAD_TRUNCATED_IMAGES = False


def check_missing(picture: Image.Image) -> str:
    """Report the missing fraction of a truncated picture; raise a UserError if it is too large.

    Raises an OSError if no part of the picture could be decoded.
    """
    pixels = np.atleast_3d(np.asarray(picture))
    fill = JPEG_FILL if picture.format in JPEGS else 0
    empty = (pixels == fill).all(2)
    share = max(_run(empty), _run(empty[::-1])) / empty.size
    if share == 1:
        raise OSError("no part of it can be decoded")
    if share > MOST_MISSING:
        part = f"it is truncated: {share:.0%} of the picture is missing"
        raise UserError(f"is damaged or cannot be decoded ({part}); get the whole file")
    return f"is truncated and painted as it is: {share:.1%} of the picture is missing"


def _run(empty: np.ndarray) -> int:
    """Count the empty pixels at the right ends of rows, from the bottom of a map (H, W) up to a row with none."""
    runs = np.where(empty.all(1), empty.shape[1], (~empty[:, ::-1]).argmax(1))[::-1]
    return int(runs[: np.argmax(np.append(runs, 0) == 0)].sum())
