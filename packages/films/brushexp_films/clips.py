"""Read films frame by frame, with display times; films are written by `brushexp.pictures.video`."""

import importlib
import logging
import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from fractions import Fraction
from itertools import islice, pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from brushexp.contracts import UserError
from brushexp.contracts.files import check_file, find_path, shorten_value
from brushexp.contracts.pictures import (
    FILM_SUFFIXES,
    MAX_PIXELS,
    MOVING,
    boxes,
    decode_image,
    has_end,
    open_of_any_size,
    picture_size,
    read_declared,
)
from brushexp_films.cropping import crop_of
from brushexp_films.frames import Shape, size_of, srgb_of

log = logging.getLogger(__name__)
USUAL_RATE = Fraction(25)  # pictures per second if a film does not state its rate
MOST_RATE = 480  # pictures per second; a film that states a higher rate counts the ticks of its clock
SAMPLE = 9  # number of pictures at the start of such a film from which its rate is estimated
SHORTEST_FRAME = Fraction(1, 500)  # seconds; pictures shown for less because clocks are rounded are dropped
MISSING = 0.5  # seconds by which a film may be shorter than its header states
LOCAL = {"protocol_whitelist": "file"}  # so that a playlist cannot open network addresses
WITH_ALPHA = {"vp9": "libvpx-vp9", "vp8": "libvpx"}  # FFmpeg's own decoders drop their transparency
MOVING_SUFFIXES = (".gif", ".webp", ".png", ".apng", ".avif", ".avifs")
BRIEF, INSTEAD = 10, 100  # milliseconds; all browsers replace delays up to ``BRIEF`` with ``INSTEAD``
FIRST_BOXES = (b"ftyp", b"wide", b"mdat", b"free", b"skip")  # possible first boxes of an MP4 or QuickTime file
CURE = "convert it to an MP4 (H.264)"
Timed = tuple[np.ndarray, Fraction, Fraction]  # picture (H, W, 3), start and length in seconds; length 0 is unknown


@dataclass(frozen=True)
class Clip:
    """A readable film and its properties."""

    path: Path
    size: tuple[int, int]  # height and width of its pictures, upright, with square pixels
    rate: Fraction  # pictures per second, on average
    count: int  # number of pictures, from the file or estimated from its length; 0 if unknown
    is_counted: bool = False  # whether the file states the count
    seconds: float = 0.0  # length of the video that the file states; 0 if it does not


class TimedPicture(NamedTuple):
    """A picture (H, W, 3), uint8 sRGB, and the start and end of its display time in seconds."""

    picture: np.ndarray
    begin: Fraction
    end: Fraction


def is_film(path: str | Path) -> bool:
    """Check whether a path has a film's suffix."""
    return Path(path).suffix.lower() in FILM_SUFFIXES


def is_moving(path: str | Path) -> bool:
    """Check whether a picture file is animated."""
    if Path(path).suffix.lower() not in MOVING_SUFFIXES or not Path(path).is_file():
        return False
    try:
        with open_of_any_size(path, MOVING) as file:
            return bool(getattr(file, "is_animated", False))
    except Exception:  # damage is reported when the file is read as a picture
        return False


def moving_pictures(path: Path) -> Iterator[Timed]:
    """Decode an animation as `read_picture` does, and yield pictures and times; decoders may raise any exception."""
    time = Fraction(0)
    with open_of_any_size(path, MOVING) as file:
        declared = read_declared(file)
        is_apart = "default_image" in file.info and file.info["default_image"]  # a PNG's fallback picture
        for number in range(int(bool(is_apart)), getattr(file, "n_frames", 1)):
            file.seek(number)
            picture = decode_image(file, declared=declared)
            stays = float(file.info.get("duration", 0) or 0)
            length = Fraction(INSTEAD if stays <= BRIEF else stays).limit_denominator(1000) / 1000
            yield picture, time, length
            time += length


def open_clip(path: Path) -> Clip:
    """Open a film or an animated picture, and read its header and first picture; raise UserError if this fails."""
    path = find_path(os.path.expanduser(path))
    if is_moving(path):
        lengths = [length for _, _, length in moving_pictures(path)]
        rate = (len(lengths) / sum(lengths, Fraction(0))).limit_denominator(1000)
        return Clip(path, picture_size(path), rate, len(lengths))
    with _open_film(path) as (container, stream):
        try:
            first = list(islice(_frames(container, stream), 1 if _is_rate(stream.average_rate) else SAMPLE))
        except _errors() as error:
            raise UserError(
                f"image={path}: none of its pictures can be decoded ({shorten_value(error)}); {CURE}"
            ) from error
        if not first:
            raise UserError(f"image={path} is a film without pictures; {CURE}")
        rate = stream.average_rate if _is_rate(stream.average_rate) else _rate_of(first)
        own = float((stream.duration or 0) * (stream.time_base or 0))  # sound may outlast the pictures
        seconds = own or (container.duration or 0) / 1e6
        size = size_of(first[0], _shape_of(path, stream))
        _check_pixels(path, *size)
        is_counted = bool(stream.frames)
        return Clip(path, size, Fraction(rate), stream.frames or round(seconds * rate), is_counted, own)


def _is_rate(rate: Fraction | None) -> bool:
    return rate is not None and 0 < rate <= MOST_RATE


def _rate_of(frames: list[Any]) -> Fraction:
    """Estimate a film's frame rate from the intervals between its first frames."""
    times = sorted(frame.pts * frame.time_base for frame in frames if frame.pts is not None)
    steps = sorted(after - before for before, after in pairwise(times) if after > before)
    return (1 / steps[len(steps) // 2]).limit_denominator(1000) if steps else USUAL_RATE


def timed_pictures(clip: Clip) -> Iterator[TimedPicture]:
    """Yield upright pictures, with times relative to the film's beginning, until the film ends or a picture is damaged.

    Each picture is shown until the next one begins. The last picture is shown for as long as the film states, or
    otherwise for as long as the picture before it.
    """
    last: Timed | None = None
    for picture, time, length in _decode(clip):
        if last is None:
            last = picture, time, length
            continue
        begin = max(time, last[1] + SHORTEST_FRAME)
        yield TimedPicture(last[0], last[1], begin)
        last = picture, begin, length or begin - last[1]
    if last is not None:
        yield TimedPicture(last[0], last[1], last[1] + (last[2] or 1 / clip.rate))


def pictures_between(clip: Clip, start: float, stop: float | None, every: int) -> Iterator[TimedPicture]:
    """Yield one in ``every`` pictures shown between two times in seconds, with display times relative to ``start``."""
    first = Fraction(start).limit_denominator(10**6)
    last = None if stop is None else Fraction(stop).limit_denominator(10**6)
    held: TimedPicture | None = None
    number = 0
    for shown in timed_pictures(clip):
        if shown.end <= first + SHORTEST_FRAME:
            continue
        if last is not None and shown.begin + SHORTEST_FRAME >= last and number:
            break
        begin, end = max(shown.begin, first), shown.end if last is None else min(shown.end, last)
        if number % every:
            assert held is not None
            held = held._replace(end=end - first)
        else:
            if held is not None:
                yield held._replace(end=begin - first)
            held = TimedPicture(shown.picture, begin - first, end - first)
        number += 1
    if held is not None:
        yield held


def _decode(clip: Clip) -> Iterator[Timed]:
    """Yield decoded pictures with their start times and durations, and warn if the film ends too early."""
    if is_moving(clip.path):
        yield from moving_pictures(clip.path)
        return
    count, end = 0, Fraction(0)
    with _open_film(clip.path) as (container, stream):
        zero, shape, base = beginning_of(container), _shape_of(clip.path, stream), stream.time_base
        try:
            for frame in _frames(container, stream):
                time = end if frame.pts is None else frame.pts * base - zero
                length = (getattr(frame, "duration", 0) or 0) * base
                length = length if length > SHORTEST_FRAME else Fraction(0)  # a single tick of a recorder's clock
                yield srgb_of(frame, shape), max(time, Fraction(0)), length
                count, end = count + 1, time + (length or 1 / clip.rate)
        except _errors() as error:
            log.warning("%s breaks off after %d pictures: %s", clip.path, count, shorten_value(error))
            return
    is_early = count + 1 < clip.count if clip.is_counted else float(end) + max(float(zero), 0) + MISSING < clip.seconds
    if is_early and count < clip.count:
        log.warning("%s has %d pictures, not the %d of its header", clip.path, count, clip.count)


def _frames(container: Any, stream: Any) -> Iterator[Any]:
    """Yield a stream's decoded frames, including their transparency."""
    has_alpha = {key.lower(): value for key, value in stream.metadata.items()}.get("alpha_mode") == "1"
    coder = WITH_ALPHA.get(stream.codec_context.name, "") if has_alpha else ""
    av = importlib.import_module("av")
    if coder not in av.codecs_available:
        yield from container.decode(stream)
        return
    own = av.CodecContext.create(coder, "r")
    for packet in container.demux(stream):
        for frame in own.decode(packet if packet.size else None):
            frame.time_base = stream.time_base
            yield frame


def _shape_of(path: Path, stream: Any) -> Shape:
    """Read a film's pixel aspect ratio and crop."""
    aspect = stream.sample_aspect_ratio
    return Shape(Fraction(aspect) if aspect else Fraction(1), crop_of(path, stream.height, stream.width))


def beginning_of(container: Any) -> Fraction:
    """Find the time on the film's own clock, in seconds, at which video or sound begins, whichever is earlier.

    Sound that leads by less than the duration of one picture is taken to start with the video, because its codec needs
    a few samples to start.
    """
    streams = [*container.streams.video[:1], *container.streams.audio[:1]]
    begins = [(stream.start_time or 0) * stream.time_base for stream in streams if stream.time_base]
    if not begins:
        return Fraction(0)
    rate = container.streams.video[0].average_rate if container.streams.video else None
    lead = 1 / rate if rate is not None and _is_rate(rate) else 1 / USUAL_RATE
    return Fraction(begins[0] if container.streams.video and begins[0] - min(begins) < lead else min(begins))


def _why_unread(path: Path, error: Exception) -> str:
    """Explain why FFmpeg cannot open a file and how to fix it."""
    if not path.stat().st_size:
        return "is empty (0 bytes); give a file that contains a film"
    if has_end(path) is False:
        return "is cut short: its file ends before the film does; get the whole file"
    with path.open("rb") as file:
        names = [name for name, _ in boxes(file, path.stat().st_size)]
    if names[0] in FIRST_BOXES and b"moov" not in names:
        why = "lacks the list of its pictures (moov), which is written last: recording or copying was interrupted"
        return f"{why}; copy it again, or repair it with a program such as untrunc"
    return f"cannot be read as a film ({getattr(error, 'strerror', None) or shorten_value(error)}); {CURE}"


@contextmanager
def _open_film(path: Path) -> Iterator[tuple[Any, Any]]:
    """Open a film, and yield its container and its first video stream."""
    check_file(path, "give a film, image=clip.mp4")
    try:
        av = importlib.import_module("av")
    except ImportError as error:
        raise UserError(f"image={path} is a film, which needs PyAV; pip install 'brushexp[video]'") from error
    try:
        container = av.open(str(path), options=LOCAL)
    except _errors() as error:
        raise UserError(f"image={path} {_why_unread(path, error)}") from error
    with container:
        if not container.streams.video:
            raise UserError(f"image={path} contains no video; give a film that does")
        stream = container.streams.video[0]
        _check_pixels(path, stream.height, stream.width)
        stream.thread_type = "AUTO"
        yield container, stream


def _check_pixels(path: Path, height: int, width: int) -> None:
    if height * width > MAX_PIXELS:
        raise UserError(f"image={path} has pictures of more than {MAX_PIXELS // 10**6} megapixels; make it smaller")


def _errors() -> tuple[type[Exception], ...]:
    return (importlib.import_module("av").error.FFmpegError, OSError, ValueError, RuntimeError)
