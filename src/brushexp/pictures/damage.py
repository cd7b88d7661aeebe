"""Report damage to picture files, as revealed by checksums or by the decoded pixels."""

import zlib
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from brushexp.errors import UserError
from brushexp.pictures.tiff_directories import COMPRESSION, FILL_ORDER, LAST_BIT_FIRST, MAGIC, main_directory

PNG = b"\x89PNG\r\n\x1a\n"
HEADER, PIXELS = b"IHDR", b"IDAT"  # chunks of a PNG
METHODS = slice(10, 13)  # compression, filter and interlace methods in the header
KNOWN_METHODS = (b"\0\0\0", b"\0\0\1")
OTHER_CASE = 0x20  # bit in the first letter of the name of an optional chunk
DEFLATE = (8, 32946)  # COMPRESSION values of deflate in a TIFF
PIECE = 2**20  # bytes read at once
SUMS_DIFFER = "is damaged: its contents do not match its checksums; get it again"
ONE_COLOR = "has one colour throughout; if it should have more, the file is damaged; get it again"


def check_sums(path: Path) -> None:
    """Raise a UserError for a PNG or deflate-compressed TIFF that does not match its checksums.

    Decoders do not verify all checksums. Missing data at the end of a file are not detected here.
    """
    with path.open("rb") as file:
        start = file.read(len(PNG))
    if start == PNG:
        _check_png(path)
    elif start[:4] in MAGIC:
        main = main_directory(path)
        if main is not None and main.number(COMPRESSION) in DEFLATE and main.number(FILL_ORDER) != LAST_BIT_FIRST:
            _check_deflated(path, main.pieces())


def _check_deflated(path: Path, pieces: Iterable[tuple[int, int]]) -> None:
    """Raise a UserError if a block, given by its offset and length, has a wrong zlib checksum (RFC 1950)."""
    with path.open("rb") as file:
        for place, length in pieces:
            file.seek(place)
            packed, unpacker = file.read(length), zlib.decompressobj()
            try:
                while packed and not unpacker.eof:
                    unpacker.decompress(packed, PIECE)
                    packed = unpacker.unconsumed_tail
            except zlib.error as error:
                raise UserError(SUMS_DIFFER) from error


def _check_png(path: Path) -> None:
    """Raise a UserError if a critical PNG chunk does not match its checksum or uses an unknown method."""
    with path.open("rb") as file:
        file.seek(len(PNG))
        while len(head := file.read(8)) == 8:
            length, name = int.from_bytes(head[:4]), head[4:]
            total, begin, left = zlib.crc32(name), b"", length
            while left and (piece := file.read(min(left, PIECE))):
                total, begin, left = zlib.crc32(piece, total), begin or piece, left - len(piece)
            stored = file.read(4)
            if left or len(stored) < 4:
                return
            if total != int.from_bytes(stored) and not name[0] & OTHER_CASE:
                raise UserError(SUMS_DIFFER)
            if name == HEADER and begin[METHODS] not in KNOWN_METHODS:
                raise UserError("is a PNG of a newer kind, which is not supported; save it again as PNG")


def remark_on(pixels: np.ndarray) -> str:
    """Return a warning if all pixels of a picture (H, W, C) have the same colour; return "" otherwise."""
    is_flat = pixels[:, :, 0].size > 1 and bool((pixels == pixels[0, 0]).all())
    return ONE_COLOR if is_flat else ""
