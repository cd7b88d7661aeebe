"""The painting as a picture of any size."""

import struct
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np
from torch import Tensor

from brushexp.plugins.export._prints import CM, PrintExporter
from brushexp.plugins.export.base import ExportJob
from brushexp.registry import register
from brushexp.system.files import replacing, to_bytes

SIGNATURE = b"\x89PNG\r\n\x1a\n"
DEPTH, RGB = 8, 2  # bits, and PNG's number for this kind of pixel
PER_METRE = 1  # PNG's number for this unit of density


@register("to", "png")
@dataclass(kw_only=True)
class Png(PrintExporter):
    """``painting.png``: the picture, crisp at any ``resolution``: the strokes are scaled, not the pixels.

    It is painted and packed in bands, so that memory does not grow with the picture. For print:
    ``to.png.size_cm=60x40``.
    """

    def write(self, job: ExportJob, folder: Path) -> list[Path]:
        job = self.sized(job)
        path, (height, width) = folder / "painting.png", job.size
        # Pillow wants the whole picture, and packs it in four bytes a pixel.
        with replacing(path) as temporary, temporary.open("wb") as file:
            file.write(SIGNATURE)
            _chunk(file, b"IHDR", struct.pack(">IIBBBBB", width, height, DEPTH, RGB, 0, 0, 0))
            if self.density:
                metre = round(100 * self.density / CM)
                _chunk(file, b"pHYs", struct.pack(">IIB", metre, metre, PER_METRE))
            for piece in self.packed(job):
                _chunk(file, b"IDAT", piece)
            _chunk(file, b"IEND", b"")
        return [path]


def pixels(job: ExportJob, flat: Tensor | None = None) -> np.ndarray:
    """The picture (H, W, 3) in 8 bits, painted in bands, so that it takes little more memory than its pixels.

    ``flat`` (3, H, W) in [0, 1] are its colours without light, if they are known.
    """
    picture = np.empty((*job.size, 3), dtype=np.uint8)
    for top, band in job.bands(flat):
        picture[top : top + band.shape[1]] = to_bytes(band)
    return picture


def _chunk(file: BinaryIO, name: bytes, data: bytes) -> None:
    if data or name == b"IEND":
        file.write(struct.pack(">I", len(data)) + name)
        file.write(data)
        file.write(struct.pack(">I", zlib.crc32(data, zlib.crc32(name))))
