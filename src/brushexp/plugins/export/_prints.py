"""Prepare pictures for printing and encode PNG chunks (ISO/IEC 15948); several exporters share this code."""

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
MM = 25.4  # millimetres in an inch
WHITE = 255  # level of white paper
DPI = 300.0  # default resolution of a print, pixels per inch
THREADS_PER_CM = 14  # threads of painters' linen
THREAD_PIXELS = 4.0  # pixels between threads if the picture has no print size
SIGNATURE = b"\x89PNG\r\n\x1a\n"
DEPTH, RGB, RGBA = 8, 2, 6  # bits of a channel, and numbers of the PNG colour types
SUB, UP = 1, 2  # numbers of the PNG filters that store differences from the previous pixel, and from the pixel above


@dataclass(kw_only=True)
class PrintExporter(Exporter):
    """Base class for exporters that write pictures at a print size; its fields are options of these exporters.

    Args:
        size_cm: maximum width and height in cm, such as 60x40; the picture is as large as possible; null = as many
            pixels as ``resolution``.
        dpi: pixels per inch, written into the file; null = 300 if ``size_cm`` is set.
        weave: strength of the canvas threads under the light, 0 to 1.
    """

    size_cm: str | None = None
    dpi: Annotated[float, between(1, 10_000, typical=DPI)] | None = None
    weave: Annotated[float, between(0, 1)] = 0.0

    def __post_init__(self) -> None:
        if self.size_cm is not None and not re.fullmatch(r"\d+(\.\d+)?x\d+(\.\d+)?", self.size_cm):
            raise UserError(
                f"{self.key}.size_cm={self.size_cm} is not a width and height; try {self.key}.size_cm=60x40"
            )

    @property
    def density(self) -> float | None:
        """Pixels per inch written into the file; None for no entry."""
        return self.dpi or (None if self.size_cm is None else DPI)

    def scale_to_paper(self, job: ExportJob) -> ExportJob:
        """Scale the painting to its print size; raise a UserError if it would have too many pixels."""
        if self.size_cm is None:
            return job
        width, height = (float(side) for side in self.size_cm.split("x"))
        pixels = round(max(job.size) * min(width / job.size[1], height / job.size[0]) * (self.density or DPI) / CM)
        if not 1 <= pixels <= LARGEST_SIDE_PIXELS:
            reason = f"{self.key}.size_cm={self.size_cm} at {self.density:g} dpi is {pixels} pixels"
            raise UserError(f"{reason}, not 1 to {LARGEST_SIDE_PIXELS}; try {self.key}.dpi=100")
        return job.scaled(pixels / max(job.size))


@dataclass(frozen=True)
class Sheet:
    """Layout of a picture on its paper, in pixels."""

    job: ExportJob  # draws the picture at its print size, including any part that is cropped
    shown: tuple[int, int]  # height and width of the visible part, the middle of the picture
    margin: int  # white paper on every side
    bleed: int  # area beyond the edges, to be cut off

    @property
    def size(self) -> tuple[int, int]:
        """Height and width of the sheet, including margin and bleed."""
        height, width = self.shown
        around = 2 * (self.margin + self.bleed)
        return height + around, width + around


@dataclass(kw_only=True)
class SheetExporter(PrintExporter):
    """Base class for exporters that write a picture on a sheet of paper; its fields are options of these exporters.

    Args:
        fill: whether the picture fills ``size_cm`` and is cropped on two sides; false = the whole picture, as large as
            possible.
        margin: white paper on every side in mm, within ``size_cm``.
        bleed: mirrored edge of the picture in mm, beyond ``size_cm`` on every side, to be trimmed by the printer;
            usually 3. With a margin, the bleed is white.
    """

    fill: bool = False
    margin: Annotated[float, between(0, 1000)] = 0.0
    bleed: Annotated[float, between(0, 100)] = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.fill and self.size_cm is None:
            raise UserError(f"{self.key}.fill=true needs a paper size; add {self.key}.size_cm=60x40")

    @property
    def density(self) -> float | None:
        """Pixels per inch written into the file; None for no entry."""
        return super().density or (DPI if self.margin or self.bleed else None)

    def sheet(self, job: ExportJob) -> Sheet:
        """Lay out the painting on its paper; raise a UserError if it does not fit or has too many pixels."""
        dpi = self.density or DPI
        margin, bleed = (round(length * dpi / MM) for length in (self.margin, self.bleed))
        if self.size_cm is not None and (self.fill or margin):
            width, height = (round(float(side) * dpi / CM) - 2 * margin for side in self.size_cm.split("x"))
            if min(height, width) < 1:
                reason = f"{self.key}.margin={self.margin:g} leaves no room on {self.key}.size_cm={self.size_cm}"
                raise UserError(f"{reason}; try {self.key}.margin=10")
            shares = height / job.size[0], width / job.size[1]
            job = job.scaled(max(shares) if self.fill else min(shares))
            shown = (height, width) if self.fill else job.size
        else:
            job = self.scale_to_paper(job)
            shown = job.size
        if bleed > min(shown) and not margin:
            raise UserError(f"{self.key}.bleed={self.bleed:g} is larger than the picture; try {self.key}.bleed=3")
        if max(job.size) > LARGEST_SIDE_PIXELS:
            reason = f"{self.key}.size_cm={self.size_cm} paints {max(job.size)} pixels a side"
            raise UserError(f"{reason}, not 1 to {LARGEST_SIDE_PIXELS}; try {self.key}.dpi=100")
        return Sheet(job, shown, margin, bleed)

    def rows(self, sheet: Sheet, *, transparent: bool = False) -> Iterator[np.ndarray]:
        """Paint the sheet, over white, in bands (h, W, 3) uint8 from top to bottom.

        If ``transparent`` is set and the painting has alpha, the bands are (h, W, 4) with straight alpha.
        """
        picture = crop(self._picture_rows(sheet.job, transparent=transparent), sheet.job.size, sheet.shown)
        if sheet.margin:
            return add_white(picture, sheet.margin + sheet.bleed)
        return mirror(picture, sheet.bleed)

    def _picture_rows(self, job: ExportJob, *, transparent: bool) -> Iterator[np.ndarray]:
        for top, band in job.bands():
            pixels = to_bytes(self.add_weave(band, top, job))
            alpha = job.alpha(top, len(pixels))
            if alpha is not None:
                pixels = np.dstack([pixels, alpha]) if transparent else over_white(pixels, alpha)
            yield pixels

    def pack_rows(self, bands: Iterator[np.ndarray], compression: int) -> Iterator[bytes]:
        """Encode bands (h, W, C) for PNG (ISO/IEC 15948) and PDF as pieces of a zlib stream of filtered rows."""
        packer, above = zlib.compressobj(compression), np.zeros((1, 1), dtype=np.uint8)
        for band in bands:
            rows = band.reshape(len(band), -1)
            filtered = np.full((len(rows), 1 + rows.shape[1]), UP, dtype=np.uint8)
            np.subtract(rows, np.concatenate([np.broadcast_to(above, rows[:1].shape), rows[:-1]]), out=filtered[:, 1:])
            yield packer.compress(filtered.data)
            above = rows[-1:]
        yield packer.flush()

    def add_weave(self, band: torch.Tensor, top: int, job: ExportJob) -> torch.Tensor:
        """Add lit canvas threads to a band (3, h, W) of the picture that starts at row ``top``."""
        if not self.weave:
            return band
        pitch = (self.density or 0) / CM / THREADS_PER_CM or THREAD_PIXELS
        height = weave_height(top - 1, band.shape[1] + 2, band.shape[2] + 2, pitch)
        facing = normals_of(height, self.weave, slice(1, -1))[:, :, 1:-1]
        return torch.from_numpy(shade_picture(band.float().cpu().numpy(), facing, replace(job.light, gloss=0.0)))


def crop(bands: Iterator[np.ndarray], size: tuple[int, int], shown: tuple[int, int]) -> Iterator[np.ndarray]:
    """Crop a picture of ``size`` (H, W), given in bands (h, W, C), to the size ``shown`` (H, W) around its centre.

    >>> picture = np.arange(16).reshape(4, 4, 1)
    >>> np.concatenate([*crop(iter([picture[:1], picture[1:]]), (4, 4), (2, 4))])[..., 0].tolist()
    [[4, 5, 6, 7], [8, 9, 10, 11]]
    """
    above, left = ((whole - part) // 2 for whole, part in zip(size, shown, strict=True))
    top = 0
    for band in bands:
        rows = band[max(0, above - top) : max(0, above + shown[0] - top), left : left + shown[1]]
        top += len(band)
        if len(rows):
            yield rows


def add_white(bands: Iterator[np.ndarray], count: int) -> Iterator[np.ndarray]:
    """Add ``count`` white pixels on every side of a picture given in bands (h, W, C)."""
    edge = np.empty(0)
    for band in bands:
        sides = np.pad(band, ((0, 0), (count, count), (0, 0)), constant_values=WHITE)
        if not edge.size:
            edge = np.full((count, *sides.shape[1:]), WHITE, np.uint8)
            yield edge
        yield sides
    yield edge


def mirror(bands: Iterator[np.ndarray], count: int) -> Iterator[np.ndarray]:
    """Extend a picture, given in bands (h, W, C), by mirroring ``count`` pixels on every side.

    >>> picture = np.arange(6).reshape(3, 2, 1)
    >>> np.concatenate([*mirror(iter([picture[:2], picture[2:]]), 1)])[..., 0].tolist()
    [[0, 0, 1, 1], [0, 0, 1, 1], [2, 2, 3, 3], [4, 4, 5, 5], [4, 4, 5, 5]]
    """
    if not count:
        yield from bands
        return
    held, is_begun = None, False
    for band in bands:
        sides = np.pad(band, ((0, 0), (count, count), (0, 0)), mode="symmetric")
        held = sides if held is None else np.concatenate([held, sides])
        if not is_begun and len(held) >= count:
            is_begun = True
            yield held[:count][::-1]
        if len(held) > count:
            yield held[:-count]
            held = held[-count:]
    if held is not None:
        yield held
        yield held[::-1]


def over_white(pixels: np.ndarray, alpha: np.ndarray) -> np.ndarray:
    """Composite pixels (h, W, 3) with alpha (h, W, 1), both uint8, over white."""
    share = alpha.astype(np.uint16)
    return ((pixels * share + 255 * (255 - share) + 127) // 255).astype(np.uint8)


def weave_height(top: int, rows: int, columns: int, pitch: float) -> np.ndarray:
    """Compute the height (rows, columns) of a plain weave whose threads are ``pitch`` pixels apart.

    Each thread is a round ridge that passes alternately over and under the threads it crosses. Where two threads cross,
    the upper one is visible.
    """
    y = (np.arange(top, top + rows, dtype=np.float32)[:, None] + 0.5) / pitch
    x = (np.arange(-1, columns - 1, dtype=np.float32)[None] + 0.5) / pitch
    sway = np.where((np.floor(x) + np.floor(y)) % 2 == 0, 1, -1) * np.abs(np.sin(np.pi * x) * np.sin(np.pi * y))
    warp, weft = np.abs(np.sin(np.pi * x)) + 0.6 * sway, np.abs(np.sin(np.pi * y)) - 0.6 * sway
    return (0.15 * pitch * np.maximum(warp, weft)).astype(np.float32)


def chunk(name: bytes, data: bytes) -> bytes:
    """Encode a PNG chunk with its length and checksum."""
    return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(data, zlib.crc32(name)))


def header(width: int, height: int, kind: int) -> bytes:
    """Encode the PNG header chunk with the picture's size and colour type."""
    return chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, DEPTH, kind, 0, 0, 0))


def bitmap(pixels: np.ndarray) -> bytes:
    """Encode uint8 pixels (H, W, 4), with straight alpha, as a PNG; Pillow would be too slow for thousands of pictures.

    Differences are computed along the longer side, which is usually the direction of the stroke's texture.
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
    packer = zlib.compressobj(strategy=zlib.Z_RLE)  # as small as by default, but four times as fast
    data = packer.compress(rows.data) + packer.flush()
    return SIGNATURE + header(width, height, RGBA) + chunk(b"IDAT", data) + chunk(b"IEND", b"")
