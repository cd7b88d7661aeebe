"""Films are read picture by picture; `brushexp.pictures.video` writes them."""

import importlib
import logging
import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from brushexp.errors import UserError
from brushexp.pictures.decode import MAX_PIXELS
from brushexp.system.reading import check_file, in_short

log = logging.getLogger(__name__)
SUFFIXES = (
    *(".mp4", ".m4v", ".mov", ".mkv", ".webm", ".avi", ".mpg", ".mpeg", ".mts", ".m2ts", ".ts", ".wmv", ".flv"),
    *(".ogv", ".3gp"),
)
USUAL_RATE = Fraction(25)  # pictures per second of a film that does not say
QUARTER = 90  # degrees
CURE = "convert it to an MP4 (H.264)"


@dataclass(frozen=True)
class Clip:
    """A film that can be read."""

    path: Path
    size: tuple[int, int]  # height and width of its pictures, upright
    rate: Fraction  # pictures per second, on average
    count: int  # of its pictures, as the file says or estimated from its length; 0 if nothing is known


def is_film(path: str | Path) -> bool:
    """Whether a path has the suffix of a film."""
    return Path(path).suffix.lower() in SUFFIXES


def open_clip(path: Path, key: str = "image") -> Clip:
    """Open a film and read its header and first picture; ``key`` is what sets the path, for messages.

    UserError if there is no such file, no video or no picture in it, or the library PyAV is missing.
    """
    path = Path(os.path.expanduser(path))
    with _decoding(path, key) as (container, stream):
        try:
            first = next(container.decode(stream), None)
        except _errors() as error:
            raise UserError(f"{key}={path}: no picture of it can be decoded ({in_short(error)}); {CURE}") from error
        if first is None:
            raise UserError(f"{key}={path} is a film without pictures; {CURE}")
        rate = stream.average_rate or stream.guessed_rate or USUAL_RATE
        seconds = float((stream.duration or 0) * (stream.time_base or 0)) or (container.duration or 0) / 1e6
        height, width = _upright(first).shape[:2]
        return Clip(path, (height, width), Fraction(rate), stream.frames or round(seconds * rate))


def decoded_pictures(clip: Clip) -> Iterator[np.ndarray]:
    """Decode the pictures (H, W, 3) uint8, sRGB, upright, one after another; none is kept.

    A film that breaks off ends with the last picture that can be decoded, and the log says so.
    """
    shown = 0
    with _decoding(clip.path, "image") as (container, stream):
        try:
            for frame in container.decode(stream):
                yield _upright(frame)
                shown += 1
        except _errors() as error:
            log.warning("%s breaks off after %d pictures: %s", clip.path, shown, in_short(error))
            return
    if shown < clip.count:
        log.warning("%s has %d pictures, and not the %d of its header", clip.path, shown, clip.count)


def _upright(frame: Any) -> np.ndarray:
    """Turn the pixels of a decoded frame as the film says."""
    turns = round(frame.rotation / QUARTER) % 4
    return np.ascontiguousarray(np.rot90(frame.to_ndarray(format="rgb24"), turns))


@contextmanager
def _decoding(path: Path, key: str) -> Iterator[tuple[Any, Any]]:
    """Open a file and choose its first video."""
    check_file(path, f"give a film, {key}=clip.mp4")
    av = _library(path, key)
    try:
        container = av.open(str(path), options={"protocol_whitelist": "file"})  # a playlist may name addresses
    except _errors() as error:
        raise UserError(f"{key}={path} cannot be read as a film ({in_short(error)}); {CURE}") from error
    with container:
        if not container.streams.video:
            raise UserError(f"{key}={path} has no video in it; give a film that has")
        stream = container.streams.video[0]
        if stream.width * stream.height > MAX_PIXELS:
            raise UserError(f"{key}={path} has pictures of more than {MAX_PIXELS // 10**6} megapixels; make it smaller")
        stream.thread_type = "AUTO"
        yield container, stream


def _library(path: Path, key: str) -> ModuleType:
    try:
        return importlib.import_module("av")
    except ImportError as error:
        raise UserError(f"{key}={path} is a film, which needs PyAV; pip install 'brushexp[video]'") from error


def _errors() -> tuple[type[Exception], ...]:
    """List what decoding may raise."""
    return (importlib.import_module("av").error.FFmpegError, OSError, ValueError, RuntimeError)
