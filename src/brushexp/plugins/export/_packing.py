"""PNG (ISO/IEC 15948) packed by ourselves: in bands, or thousands of small bitmaps, for which Pillow takes too long."""

import struct
import zlib

import numpy as np

SIGNATURE = b"\x89PNG\r\n\x1a\n"
DEPTH, RGB, RGBA = 8, 2, 6  # bits, and PNG's numbers for these kinds of pixels
SUB, UP = 1, 2  # PNG's filters: a byte less that of the pixel before it, or above it


def chunk(name: bytes, data: bytes) -> bytes:
    """A part of a PNG, with its length and checksum."""
    return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(data, zlib.crc32(name)))


def header(width: int, height: int, kind: int) -> bytes:
    """The part that says what the pixels are."""
    return chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, DEPTH, kind, 0, 0, 0))


def bitmap(pixels: np.ndarray) -> bytes:
    """A whole PNG of pixels (H, W, 4) uint8, straight alpha; as small as Pillow's within a few percent.

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
