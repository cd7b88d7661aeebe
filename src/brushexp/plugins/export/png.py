"""The painting as a picture of any size."""

import struct
import zlib
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
        path, (height, width) = folder / "painting.png", job.size
        packer, above = zlib.compressobj(self.compression), np.zeros((1, 3 * width), dtype=np.uint8)
        # As in ISO/IEC 15948; Pillow wants the whole picture, and packs it in four bytes a pixel.
        with replacing(path) as temporary, temporary.open("wb") as file:
            file.write(SIGNATURE)
            _chunk(file, b"IHDR", struct.pack(">IIBBBBB", width, height, DEPTH, RGB, 0, 0, 0))
            for _, band in job.bands():
                rows = to_bytes(band).reshape(-1, 3 * width)
                filtered = np.full((len(rows), 1 + 3 * width), UP, dtype=np.uint8)
                np.subtract(rows, np.concatenate([above, rows[:-1]]), out=filtered[:, 1:])
                _chunk(file, b"IDAT", packer.compress(filtered.data))
                above = rows[-1:]
            _chunk(file, b"IDAT", packer.flush())
            _chunk(file, b"IEND", b"")
        return [path]


def pixels(job: ExportJob) -> np.ndarray:
    """The picture (H, W, 3) in 8 bits, painted in bands, so that it takes little more memory than its pixels."""
    picture = np.empty((*job.size, 3), dtype=np.uint8)
    for top, band in job.bands():
        picture[top : top + band.shape[1]] = to_bytes(band)
    return picture


def _chunk(file: BinaryIO, name: bytes, data: bytes) -> None:
    if data or name == b"IEND":
        file.write(struct.pack(">I", len(data)) + name)
        file.write(data)
        file.write(struct.pack(">I", zlib.crc32(data, zlib.crc32(name))))
