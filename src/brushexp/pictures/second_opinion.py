"""Check a picture with other installed decoders, which may detect damage that the usual decoder misses."""

import importlib
from contextlib import suppress
from pathlib import Path
from typing import Any

from brushexp.pictures.limits import MAX_PIXELS

REPORTED = "may be damaged: a decoder found errors in it; compare it with another copy"
BY_LIBVIPS = {"AVIF": "heifload", "JPEG": "jpegload", "MPO": "jpegload"}  # format -> reader in the extra "canvas"
BY_FFMPEG = {"JPEG": "mjpeg", "MPO": "mjpeg", "JPEG2000": "jpeg2000"}  # format -> decoder in the extra "video"
UNREAD = ("nsupported", "not implemented")  # words with which a decoder reports an unsupported variant


def remark_of_others(path: Path, kind: str, pixels: int) -> str:
    """Return a warning if another installed decoder finds damage in a picture; return "" otherwise.

    Pictures of more than 100 megapixels are not decoded again.
    """
    if pixels > MAX_PIXELS:
        return ""
    is_damaged = (kind in BY_LIBVIPS and _fails_in_libvips(path, kind)) or (
        kind in BY_FFMPEG and _fails_in_ffmpeg(path, kind)
    )
    return REPORTED if is_damaged else ""


def _fails_in_libvips(path: Path, kind: str) -> bool:
    """Check whether libvips can open a picture, but warns or fails when it decodes the pixels."""
    with suppress(ImportError, OSError):  # OSError means that the library itself is missing
        vips: Any = importlib.import_module("pyvips")
        try:
            picture = getattr(vips.Image, BY_LIBVIPS[kind])(str(path), access="sequential", fail_on="warning")
        except vips.Error:  # an unsupported variant, or a warning about tags and profiles
            return False
        try:
            picture.avg()
        except vips.Error as error:
            return not any(words in str(error) for words in UNREAD)
    return False


def _fails_in_ffmpeg(path: Path, kind: str) -> bool:
    """Check whether FFmpeg finds errors in the compressed pixels of a picture."""
    with suppress(ImportError):
        av: Any = importlib.import_module("av")
        coder: Any = av.CodecContext.create(BY_FFMPEG[kind], "r")
        coder.options = {"err_detect": "explode"}
        level = av.logging.get_level()
        av.logging.set_level(av.logging.WARNING)
        try:
            with av.logging.Capture() as lines:
                for packet in (av.Packet(path.read_bytes()), None):
                    coder.decode(packet)
        except av.error.InvalidDataError:
            return True
        except av.error.FFmpegError:  # an unsupported variant
            return False
        finally:
            av.logging.set_level(level)
        return any("End mismatch" in line for _, _, line in lines)  # JPEG 2000: a block ends too early or too late
    return False
