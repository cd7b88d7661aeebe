"""Pack parts of PNG files (ISO/IEC 15948); Pillow packs no bands, and thousands of small bitmaps too slowly."""

import struct
import zlib

import numpy as np

SIGNATURE = b"\x89PNG\r\n\x1a\n"
DEPTH, RGB, RGBA = 8, 2, 6  # bits of a channel, and numbers of the PNG colour types
SUB, UP = 1, 2  # numbers of the PNG filters that store the difference from the pixel before, or above


def chunk(name: bytes, data: bytes) -> bytes:
    """Pack a part of a PNG, with its length and checksum."""
    return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(data, zlib.crc32(name)))


def header(width: int, height: int, kind: int) -> bytes:
    """Pack the part that states size and colour type."""
    return chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, DEPTH, kind, 0, 0, 0))


def bitmap(pixels: np.ndarray) -> bytes:
    """Pack pixels (H, W, 4) uint8, straight alpha, as a PNG; within a few percent as small as that of Pillow.

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
