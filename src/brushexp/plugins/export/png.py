"""The painting as a picture of any size."""

import struct
import zlib
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, BinaryIO

import numpy as np

from brushexp.bounds import between
from brushexp.plugins.export.base import Exporter, ExportJob
from brushexp.registry import register
from brushexp.system.files import replacing, to_bytes

SIGNATURE = b"\x89PNG\r\n\x1a\n"
DEPTH, RGB = 8, 2  # bits, and PNG's number for this kind of pixel
UP = 2  # PNG's number for the filter that leaves the difference from the pixel above


@register("to", "png")
class Png(Exporter):
    """``painting.png``: the picture, crisp at any ``resolution``: the strokes are scaled, not the pixels.

    It is painted and packed in bands, so that memory does not grow with the picture.

    Args:
        compression: 1 is fast, 9 small.
    """

    def __init__(self, *, compression: Annotated[int, between(1, 9)] = 6) -> None:
        self.compression = compression

    def write(self, job: ExportJob, folder: Path) -> list[Path]:
        path = folder / "painting.png"
        with replacing(path) as temporary, temporary.open("wb") as file:
            write_png(file, (to_bytes(band) for _, band in job.bands()), job.size, self.compression)
        return [path]


def pixels(job: ExportJob) -> np.ndarray:
    """The picture (H, W, 3) in 8 bits, painted in bands, so that it takes little more memory than its pixels."""
    picture = np.empty((*job.size, 3), dtype=np.uint8)
    for top, band in job.bands():
        picture[top : top + band.shape[1]] = to_bytes(band)
    return picture


def write_png(file: BinaryIO, bands: Iterable[np.ndarray], size: tuple[int, int], compression: int) -> None:
    """Write a PNG (ISO/IEC 15948) from bands of pixels (h, W, 3) in 8 bits, as they come, from top to bottom.

    Pillow wants the whole picture, and packs it in four bytes a pixel.
    """
    height, width = size
    file.write(SIGNATURE)
    _chunk(file, b"IHDR", struct.pack(">IIBBBBB", width, height, DEPTH, RGB, 0, 0, 0))
    packer = zlib.compressobj(compression)
    above = np.zeros((1, 3 * width), dtype=np.uint8)
    for band in bands:
        rows = band.reshape(len(band), 3 * width)
        filtered = np.full((len(rows), 1 + 3 * width), UP, dtype=np.uint8)
        np.subtract(rows, np.concatenate([above, rows[:-1]]), out=filtered[:, 1:])
        _chunk(file, b"IDAT", packer.compress(filtered.data))
        above = rows[-1:]
    _chunk(file, b"IDAT", packer.flush())
    _chunk(file, b"IEND", b"")


def _chunk(file: BinaryIO, name: bytes, data: bytes) -> None:
    if data or name == b"IEND":
        file.write(struct.pack(">I", len(data)) + name)
        file.write(data)
        file.write(struct.pack(">I", zlib.crc32(data, zlib.crc32(name))))
