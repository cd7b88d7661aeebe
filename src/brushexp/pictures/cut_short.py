"""A picture whose file ends too soon is painted as far as it goes, or refused where much of it is missing."""

import io
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from PIL import Image, ImageFile

from brushexp.errors import UserError

END_OF_JPEG = b"\xff\xd9"
ENDS = {"JPEG": END_OF_JPEG, "MPO": END_OF_JPEG, "JPEG2000": END_OF_JPEG, "PNG": b"IEND", "GIF": b";"}
TAIL = 2**16  # bytes at the end of a file, among which its end is sought: some append more than a picture
ROW_BY_ROW = ("JPEG", "MPO", "PNG", "GIF", "TIFF", "BMP", "DIB", "TGA", "PPM")  # formats that decode what there is
MOST_MISSING = 0.05  # share of the pixels without which a picture is still painted
JPEG_FILL = 128  # grey level of what a JPEG lacks; in other formats 0


def looks_whole(path: Path, kind: str) -> bool:
    """Test whether the file of a picture has an end; False also where its format does not say."""
    size = path.stat().st_size
    with path.open("rb") as file:
        head = file.read(8)
        file.seek(max(0, size - TAIL))
        tail = file.read()
    if kind == "WEBP":
        return size >= 8 + int.from_bytes(head[4:], "little")
    return kind in ENDS and ENDS[kind] in tail


def rescued(path: Path, kind: str) -> ImageFile.ImageFile | None:
    """Reopen a picture that is cut short so that what there is of it can be decoded; None if it is not, or cannot."""
    if kind not in ROW_BY_ROW or looks_whole(path, kind):
        return None
    is_jpeg = ENDS.get(kind) == END_OF_JPEG
    return Image.open(io.BytesIO(path.read_bytes() + (END_OF_JPEG if is_jpeg else b"")))


@contextmanager
def lenient() -> Iterator[None]:
    """Let Pillow decode what there is of a file that is cut short."""
    ImageFile.LOAD_TRUNCATED_IMAGES = True
    try:
        yield
    finally:
        ImageFile.LOAD_TRUNCATED_IMAGES = False


def check_missing(picture: Image.Image) -> str:
    """Say how much of a rescued picture is missing; a UserError if that is much, an OSError if it is all."""
    pixels = np.atleast_3d(np.asarray(picture))
    fill = JPEG_FILL if ENDS.get(picture.format or "") == END_OF_JPEG else 0
    empty = (pixels == fill).all(2)
    share = max(_run(empty), _run(empty[::-1])) / empty.size
    if share == 1:
        raise OSError("nothing of it can be decoded")
    if share > MOST_MISSING:
        part = f"it is cut short: {share:.0%} of the picture are missing"
        raise UserError(f"is damaged or cannot be decoded ({part}); get the whole file")
    return f"is cut short, and painted as it is: {share:.1%} of the picture are missing"


def _run(empty: np.ndarray) -> int:
    """Count the empty pixels (H, W) at the ends of the last rows, up to the first row that has none there."""
    runs = np.where(empty.all(1), empty.shape[1], (~empty[:, ::-1]).argmax(1))[::-1]
    return int(runs[: np.argmax(np.append(runs, 0) == 0)].sum())
