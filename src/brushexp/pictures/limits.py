"""Reject pictures that are too large for memory, or read them at a smaller size if their format allows it."""

import math
from pathlib import Path
from threading import RLock

from PIL import Image
from PIL.ImageFile import ImageFile

from brushexp.errors import UserError

MAX_PIXELS = 100_000_000  # 1.2 GB in float32 RGB
MOST_PIXELS = 10 * MAX_PIXELS  # limit for files that can be read at a fraction of their size
MOST_WHOLE = 2 * MAX_PIXELS  # limit for 8-bit pictures that are decoded at once and then shrunk
IN_PARTS = ("JPEG", "MPO", "JPEG2000", "TIFF")  # formats that can decode a fraction of their pixels
AT_ONCE = ("PNG", "WEBP", "BMP", "PPM", "TGA", "AVIF", "HEIF")  # formats that decode all pixels at once, 8 bits each
EXAMPLE = 4096  # pixels on a side that messages suggest
alone = RLock()  # a process has a single stderr, list of warnings, and pixel limit of Pillow


def open_of_any_size(path: str | Path, formats: tuple[str, ...] | None = None) -> ImageFile:
    """Open a picture without decoding it; `check_pixels` replaces Pillow's own limit on pixels."""
    with alone:
        most, Image.MAX_IMAGE_PIXELS = Image.MAX_IMAGE_PIXELS, None
        try:
            return Image.open(path, formats=formats)
        finally:
            Image.MAX_IMAGE_PIXELS = most


def check_pixels(width: int, height: int, kind: str, side: int | None) -> None:
    """Raise a UserError if a picture is too large, given its format ``kind``.

    The picture is to be read at ``side`` pixels on the longer side or, if this is None, in full.
    """
    if width * height <= MAX_PIXELS:
        return
    largest = MOST_PIXELS if kind in IN_PARTS else MOST_WHOLE if kind in AT_ONCE else MAX_PIXELS
    if width * height > largest:
        most = f"the limit is {largest // 10**6} megapixels"
        raise UserError(f"has {width} x {height} pixels; {most}: give a smaller version")
    if side is None:
        raise UserError(too_large(width, height))


def too_large(width: int, height: int) -> str:
    """Explain that a picture is too large to be read in full."""
    most = f"at most {MAX_PIXELS // 10**6} megapixels are read in full"
    return f"has {width} x {height} pixels; {most}: add resolution={EXAMPLE} to read it smaller"


def check_whole(width: int, height: int, is_deep: bool = False) -> None:
    """Raise a UserError if a picture is too large to be decoded in one piece; ``is_deep`` means more than 8 bits."""
    most = MAX_PIXELS if is_deep else MOST_WHOLE
    if width * height > most:
        size = f"has {width} x {height} pixels, which its compression unpacks all at once"
        raise UserError(f"{size}; save it with at most {most // 10**6} megapixels, or as a deflate TIFF in tiles")


def halvings(width: int, height: int, side: int, most: int) -> int:
    """Compute how many times, at most ``most``, a picture above 100 megapixels is halved to fit ``side`` and memory."""
    if width * height <= MAX_PIXELS:
        return 0
    wanted = int(math.log2(max(1, max(width, height) / side)))
    needed = math.ceil(math.log2(width * height / MOST_WHOLE) / 2)
    return min(most, max(wanted, needed, 0))


def size_of_jxl(head: bytes) -> tuple[int, int]:
    """Read the width and height of a JPEG XL file (ISO/IEC 18181-1, "SizeHeader") from its first bytes."""
    start = head.find(b"\xff\x0a") + 2
    bits, at = int.from_bytes(head[start : start + 16], "little"), 0

    def take(count: int) -> int:
        nonlocal at
        at += count
        return (bits >> (at - count)) & ((1 << count) - 1)

    def length(is_small: int) -> int:
        return 8 * (take(5) + 1) if is_small else take((9, 13, 18, 30)[take(2)]) + 1

    is_small = take(1)
    height, ratio = length(is_small), take(3)
    across, down = ((1, 1), (1, 1), (12, 10), (4, 3), (3, 2), (16, 9), (5, 4), (2, 1))[ratio]
    return height * across // down if ratio else length(is_small), height
