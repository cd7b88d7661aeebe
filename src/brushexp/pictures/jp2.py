"""Decode JPEG 2000 files above 8 bits or 100 megapixels with FFmpeg.

Pillow would let white overflow above 8 bits, and would decode every pixel of large files.
"""

import importlib
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from PIL.ImageFile import ImageFile
from PIL.Jpeg2KImagePlugin import Jpeg2KImageFile

from brushexp.errors import UserError
from brushexp.pictures.carriers import head_of
from brushexp.pictures.kinds import CURE
from brushexp.pictures.limits import MAX_PIXELS, halvings

CODESTREAM, BITS_AT = b"\xff\x4f\xff\x51", 42  # start of the codestream; offset from there of the bit depth
CODING, LEVELS_AT, LEVELS = b"\xff\x52", 9, 5  # a marker, the offset of the number of levels, its usual value


def levels_of(picture: ImageFile) -> int:
    """Read how many times a JPEG 2000 picture can be halved in size during decoding."""
    _, _, stream = head_of(picture).partition(CODESTREAM)
    at = stream.find(CODING) + LEVELS_AT
    return stream[at] if LEVELS_AT <= at < len(stream) else LEVELS


def bits_of(picture: ImageFile) -> int | None:
    """Read the bits per colour of a JPEG 2000 that only FFmpeg can decode correctly; None for any other picture."""
    if not isinstance(picture, Jpeg2KImageFile):
        return None
    head = head_of(picture)
    at = head.find(CODESTREAM) + BITS_AT
    bits = (head[at] & 127) + 1 if BITS_AT <= at < len(head) else 8
    wrapped = bits > 8 and picture.mode not in ("L", "I;16")
    return bits if wrapped or picture.width * picture.height > MAX_PIXELS else None


def read_jp2(path: Path, picture: ImageFile, bits: int, side: int | None) -> tuple[np.ndarray, np.ndarray | None]:
    """Decode colours (H, W, 3) and alpha (H, W, 1) to float32 in [0, 1], at a smaller size above 100 megapixels."""
    av = _ffmpeg(picture, bits)
    coder: Any = av.CodecContext.create("jpeg2000", "r")
    coder.options = {"lowres": str(halvings(picture.width, picture.height, side or 1, levels_of(picture)))}
    frame = next(frame for packet in (av.Packet(path.read_bytes()), None) for frame in coder.decode(packet))
    unit = frame.to_ndarray(format="rgba64le") / np.float32(((1 << bits) - 1) << (16 - bits) if bits > 8 else 65535)
    return unit[..., :3].clip(0, 1), unit[..., 3:].clip(0, 1) if picture.mode in ("LA", "RGBA") else None


def check_decoder(picture: ImageFile) -> None:
    """Raise a UserError for a JPEG 2000 that needs FFmpeg if FFmpeg is missing."""
    if bits := bits_of(picture):
        _ffmpeg(picture, bits)


def _ffmpeg(picture: ImageFile, bits: int) -> ModuleType:
    try:
        return importlib.import_module("av")
    except ImportError as error:
        needs = (
            f"is a JPEG 2000 of {bits} bits per colour and {picture.width} x {picture.height} pixels, which needs PyAV"
        )
        raise UserError(f"{needs}; pip install 'brushexp[video]', or {CURE}") from error
