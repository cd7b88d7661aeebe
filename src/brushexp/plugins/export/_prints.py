"""Prepare pictures for print, and pack parts of PNG files (ISO/IEC 15948), for several exporters."""

import re
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
import torch

from brushexp.bounds import between
from brushexp.errors import UserError
from brushexp.plugins.export.base import LARGEST_SIDE_PIXELS, Exporter, ExportJob
from brushexp.shading.light import normals_of, shade_picture
from brushexp.system.files import to_bytes

Compression = Annotated[int, between(1, 9)]
CM = 2.54  # centimetres in an inch
DPI = 300.0  # pixels per inch of a size on paper, by default
THREADS_PER_CM = 14  # threads of painters' linen
THREAD_PIXELS = 4.0  # pixels from thread to thread where the picture has no size on paper
SIGNATURE = b"\x89PNG\r\n\x1a\n"
DEPTH, RGB, RGBA = 8, 2, 6  # bits of a channel, and numbers of the PNG colour types
SUB, UP = 1, 2  # numbers of the PNG filters that store the difference from the pixel before, or above


@dataclass(kw_only=True)
class PrintExporter(Exporter):
    """Writes a picture with a size on paper. Its fields are options of every such exporter.

    Args:
        size_cm: 60x40: so many centimetres wide and high at most, the picture is as large as fits; null = as many
            pixels as ``resolution`` says.
        dpi: pixels per inch, written into the file; null = 300 where there is a size on paper.
        weave: how much the threads of the canvas show under the light, 0 (not) to 1.
    """

    size_cm: str | None = None
    dpi: Annotated[float, between(1, 10_000)] | None = None
    weave: Annotated[float, between(0, 1)] = 0.0

    def __post_init__(self) -> None:
        if self.size_cm is not None and not re.fullmatch(r"\d+(\.\d+)?x\d+(\.\d+)?", self.size_cm):
            raise UserError(f"{self.key}.size_cm={self.size_cm} is no width and height; try {self.key}.size_cm=60x40")

    @property
    def density(self) -> float | None:
        """Pixels per inch that the file states; None if it states none."""
        return self.dpi or (None if self.size_cm is None else DPI)

    def scale_to_paper(self, job: ExportJob) -> ExportJob:
        """Scale the painting to its size on paper; a UserError if that has too many pixels."""
        if self.size_cm is None:
            return job
        width, height = (float(side) for side in self.size_cm.split("x"))
        pixels = round(max(job.size) * min(width / job.size[1], height / job.size[0]) * (self.density or DPI) / CM)
        if not 1 <= pixels <= LARGEST_SIDE_PIXELS:
            reason = f"{self.key}.size_cm={self.size_cm} at {self.density:g} dpi is {pixels} pixels"
            raise UserError(f"{reason}, not 1 to {LARGEST_SIDE_PIXELS}; try {self.key}.dpi=100")
        return job.scaled(pixels / max(job.size))

    def rows(self, job: ExportJob, *, transparent: bool = False) -> Iterator[np.ndarray]:
        """Paint the picture from top to bottom, in bands (h, W, 3) uint8, over white.

        If it is ``transparent``, and the painting is, bands are (h, W, 4), straight alpha.
        """
        for top, band in job.bands():
            pixels = to_bytes(self.add_weave(band, top, job))
            alpha = job.alpha(top, len(pixels))
            if alpha is not None:
                pixels = np.dstack([pixels, alpha]) if transparent else over_white(pixels, alpha)
            yield pixels

    def pack_rows(self, bands: Iterator[np.ndarray], compression: int) -> Iterator[bytes]:
        """Pack bands (h, W, C) as PNG (ISO/IEC 15948) and PDF store them: filtered rows, pieces of a zlib stream."""
        packer, above = zlib.compressobj(compression), np.zeros((1, 1), dtype=np.uint8)
        for band in bands:
            rows = band.reshape(len(band), -1)
            filtered = np.full((len(rows), 1 + rows.shape[1]), UP, dtype=np.uint8)
            np.subtract(rows, np.concatenate([np.broadcast_to(above, rows[:1].shape), rows[:-1]]), out=filtered[:, 1:])
            yield packer.compress(filtered.data)
            above = rows[-1:]
        yield packer.flush()

    def add_weave(self, band: torch.Tensor, top: int, job: ExportJob) -> torch.Tensor:
        """Light the threads of a canvas below rows (3, h, W) of the picture, from row ``top`` on."""
        if not self.weave:
            return band
        pitch = (self.density or 0) / CM / THREADS_PER_CM or THREAD_PIXELS
        height = weave_height(top - 1, band.shape[1] + 2, band.shape[2] + 2, pitch)
        facing = normals_of(height, self.weave, slice(1, -1))[:, :, 1:-1]
        return torch.from_numpy(shade_picture(band.float().cpu().numpy(), facing, replace(job.light, gloss=0.0)))


def over_white(pixels: np.ndarray, alpha: np.ndarray) -> np.ndarray:
    """Lay pixels (h, W, 3) with an alpha (h, W, 1), all of them uint8, over white."""
    share = alpha.astype(np.uint16)
    return ((pixels * share + 255 * (255 - share) + 127) // 255).astype(np.uint8)


def weave_height(top: int, rows: int, columns: int, pitch: float) -> np.ndarray:
    """Compute the height (rows, columns) of a plain weave, whose threads are ``pitch`` pixels apart and cross in turn.

    A thread is a round ridge that rises over one and dips under the next; the higher of the two is visible.
    """
    y = (np.arange(top, top + rows, dtype=np.float32)[:, None] + 0.5) / pitch
    x = (np.arange(-1, columns - 1, dtype=np.float32)[None] + 0.5) / pitch
    sway = np.where((np.floor(x) + np.floor(y)) % 2 == 0, 1, -1) * np.abs(np.sin(np.pi * x) * np.sin(np.pi * y))
    warp, weft = np.abs(np.sin(np.pi * x)) + 0.6 * sway, np.abs(np.sin(np.pi * y)) - 0.6 * sway
    return (0.15 * pitch * np.maximum(warp, weft)).astype(np.float32)


def chunk(name: bytes, data: bytes) -> bytes:
    """Pack a part of a PNG, with its length and checksum."""
    return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(data, zlib.crc32(name)))


def header(width: int, height: int, kind: int) -> bytes:
    """Pack the part that states size and colour type."""
    return chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, DEPTH, kind, 0, 0, 0))


def bitmap(pixels: np.ndarray) -> bytes:
    """Pack pixels (H, W, 4) uint8, straight alpha, as a PNG; Pillow is too slow for thousands of them.

    Differences are taken along the longer side, which is that of a stroke: its texture runs along it.
    """
    height, width, channels = pixels.shape
    bytes_of = np.ascontiguousarray(pixels).reshape(height, -1)
    along = width > height
    rows = np.empty((height, 1 + channels * width), np.uint8)
    rows[:, 0], rows[:, 1:] = SUB if along else UP, bytes_of
    if along:
        rows[:, 1 + channels :] -= bytes_of[:, :-channels]
    else:
        rows[1:, 1:] -= bytes_of[:-1]
    packer = zlib.compressobj(strategy=zlib.Z_RLE)  # as small as by default, in a quarter of the time
    data = packer.compress(rows.data) + packer.flush()
    return SIGNATURE + header(width, height, RGBA) + chunk(b"IDAT", data) + chunk(b"IEND", b"")
