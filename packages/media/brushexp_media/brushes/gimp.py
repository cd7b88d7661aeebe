"""Read GIMP brushes: .gbr with one stamp, and .gih with several (devel-docs/gbr.txt and gih.txt in GIMP's source)."""

import struct
from dataclasses import dataclass

import numpy as np

from brushexp.contracts import UserError

MAGIC = b"GIMP"
BEFORE_NAME = {1: 20, 2: 28}  # bytes of the header before the name, by version; the name fills the rest
LARGEST_SIDE = 4096  # pixels of a side
MOST_STAMPS = 256
CURE = "save it anew from GIMP as .gbr or .gih, or as PNG"


@dataclass(frozen=True, eq=False)
class Stamp:
    """The mark that a brush leaves where it touches the canvas."""

    coverage: np.ndarray  # (H, W) float32 in [0, 1]
    spacing: float  # distance between stamps relative to the longer side, above 0


def read_stamps(data: bytes) -> list[Stamp]:
    """Read all stamps of a .gbr or .gih file; raise a UserError that says what is wrong."""
    if is_gbr(data):
        return [_read_gbr(data, 0)[0]]
    parts = data.split(b"\n", 2)
    count = parts[1].split(b" ")[0] if len(parts) == 3 else b""
    if not count.isdigit() or not 1 <= int(count) <= MOST_STAMPS:
        raise UserError(f"is no brush of GIMP that can be read; {CURE}")
    stamps, at = [], len(data) - len(parts[2])
    for _ in range(int(count)):
        stamp, at = _read_gbr(data, at)
        stamps.append(stamp)
    return stamps


def is_gbr(data: bytes) -> bool:
    """Check whether data starts with a .gbr header of version 1, which has no magic number, or of version 2."""
    if len(data) < BEFORE_NAME[1]:
        return False
    header, version, _, _, depth = struct.unpack_from(">5I", data)
    return BEFORE_NAME.get(version, len(data)) < header and depth in (1, 4) and (version == 1 or data[20:24] == MAGIC)


def _read_gbr(data: bytes, at: int) -> tuple[Stamp, int]:
    """Read the stamp at a byte offset, and return it with the offset of its end; coverage is the last channel."""
    if not is_gbr(data[at : at + BEFORE_NAME[2]]):
        raise UserError(f"is damaged, or a brush of GIMP of a kind that is not read; {CURE}")
    header, version, width, height, depth = struct.unpack_from(">5I", data, at)
    begin, end = at + header, at + header + width * height * depth
    if not (0 < width <= LARGEST_SIDE and 0 < height <= LARGEST_SIDE) or end > len(data):
        raise UserError(f"claims {width} x {height} pixels, of which not all are there; {CURE}")
    pixels = np.frombuffer(data[begin:end], np.uint8).reshape(height, width, depth)
    percent = struct.unpack_from(">I", data, at + 24)[0] if version == 2 else 25
    return Stamp(pixels[..., -1].astype(np.float32) / 255, min(max(percent, 1), 1000) / 100), end
