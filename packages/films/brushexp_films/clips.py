"""Films are read picture by picture, and their sound is copied; `brushexp.pictures.video` writes pictures."""

import heapq
import importlib
import logging
import math
import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

from brushexp.errors import UserError
from brushexp.pictures.limits import MAX_PIXELS
from brushexp.pictures.video import FAST_START
from brushexp.system.files import replacing
from brushexp.system.reading import check_file, in_short

log = logging.getLogger(__name__)
SUFFIXES = (
    *(".mp4", ".m4v", ".mov", ".mkv", ".webm", ".avi", ".mpg", ".mpeg", ".mts", ".m2ts", ".ts", ".wmv", ".flv"),
    *(".ogv", ".3gp"),
)
USUAL_RATE = Fraction(25)  # pictures per second of a film that does not say
CURE = "convert it to an MP4 (H.264)"


@dataclass(frozen=True)
class Clip:
    """A film that can be read."""

    path: Path
    size: tuple[int, int]  # height and width of its pictures, upright
    rate: Fraction  # pictures per second, on average
    count: int  # of its pictures, as the file says or estimated from its length; 0 if nothing is known


def is_film(path: str | Path) -> bool:
    """Test whether a path has the suffix of a film."""
    return Path(path).suffix.lower() in SUFFIXES


def open_clip(path: Path, key: str = "image") -> Clip:
    """Open a film and read its header and first picture (UserError); ``key`` sets the path, for messages."""
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


def decode_pictures(clip: Clip) -> Iterator[np.ndarray]:
    """Decode the pictures (H, W, 3) uint8, sRGB, upright, one by one, until the film ends or breaks off."""
    count = 0
    with _decoding(clip.path, "image") as (container, stream):
        try:
            for frame in container.decode(stream):
                yield _upright(frame)
                count += 1
        except _errors() as error:
            log.warning("%s breaks off after %d pictures: %s", clip.path, count, in_short(error))
            return
    if count < clip.count:
        log.warning("%s has %d pictures, and not the %d of its header", clip.path, count, clip.count)


def _upright(frame: Any) -> np.ndarray:
    turns = round(frame.rotation / 90) % 4
    return np.ascontiguousarray(np.rot90(frame.to_ndarray(format="rgb24"), turns))


@contextmanager
def _decoding(path: Path, key: str) -> Iterator[tuple[Any, Any]]:
    """Open a file and choose its first video."""
    check_file(path, f"give a film, {key}=clip.mp4")
    try:
        av = importlib.import_module("av")
    except ImportError as error:
        raise UserError(f"{key}={path} is a film, which needs PyAV; pip install 'brushexp[video]'") from error
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


def _errors() -> tuple[type[Exception], ...]:
    return (importlib.import_module("av").error.FFmpegError, OSError, ValueError, RuntimeError)


def add_sound(film: Path, source: Path, start: float = 0.0) -> None:
    """Copy the sound of ``source`` from second ``start`` on into an MP4, as long as it is, if an MP4 can hold it."""
    av = importlib.import_module("av")
    local = {"protocol_whitelist": "file"}
    with av.open(str(source), options=local) as original, av.open(str(film), options=local) as painted:
        if not original.streams.audio:
            return
        sound, end = original.streams.audio[0], start + (painted.duration or 0) / av.time_base
        try:
            with replacing(film) as temporary, av.open(str(temporary), "w", options=FAST_START) as both:
                into = [both.add_stream_from_template(stream) for stream in (painted.streams.video[0], sound)]
                pictures = _packets(painted, painted.streams.video[0], into[0], 0.0, math.inf)
                sounds = _packets(original, sound, into[1], start, end)
                for packet in heapq.merge(pictures, sounds, key=lambda packet: packet.dts * packet.time_base):
                    both.mux(packet)
        except (av.error.FFmpegError, ValueError):
            log.warning("the sound of %s (%s) is left out: an MP4 cannot hold it", source, sound.codec.name)


def _packets(container: Any, stream: Any, into: Any, start: float, end: float) -> Iterator[Any]:
    """Copy the packets of a stream between two seconds into another stream, from second 0 on."""
    before = round(start / stream.time_base)
    for packet in container.demux(stream):
        if packet.pts is not None and start <= packet.pts * packet.time_base < end:
            packet.pts, packet.dts, packet.stream = packet.pts - before, packet.dts - before, into
            yield packet
