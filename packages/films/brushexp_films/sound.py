"""Copy a film's sound into its painting, in sync with the pictures."""

import heapq
import importlib
import logging
import math
from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path
from typing import Any

from brushexp.contracts.files import replacing
from brushexp.contracts.pictures import FAST_START
from brushexp_films.clips import LOCAL, beginning_of, is_moving

log = logging.getLogger(__name__)


def add_sound(film: Path, source: Path, start: float = 0.0) -> None:
    """Copy the sound of ``source``, from ``start`` seconds on, into an MP4 film, if the MP4 format supports it.

    The start is relative to the beginning of the source, and the sound is cut at the end of the film. Sound that an MP4
    cannot contain is omitted with a warning. Additional sound tracks and subtitles are reported but not copied.
    """
    if is_moving(source):
        return
    av = importlib.import_module("av")
    with av.open(str(source), options=LOCAL) as original, av.open(str(film), options=LOCAL) as painted:
        log_omitted_tracks(original, source)
        if not original.streams.audio:
            return
        sound, since = original.streams.audio[0], beginning_of(original) + Fraction(start).limit_denominator(10**6)
        pictures = painted.streams.video[0]
        end = since + Fraction((painted.duration or 0) + (painted.start_time or 0), av.time_base)
        try:
            with replacing(film) as temporary, av.open(str(temporary), "w", options=FAST_START) as both:
                into = [both.add_stream_from_template(stream) for stream in (pictures, sound)]
                seen = _packets(painted, pictures, into[0], Fraction(0), math.inf)
                heard = _packets(original, sound, into[1], since, end)
                for packet in heapq.merge(seen, heard, key=lambda packet: packet.dts * packet.time_base):
                    both.mux(packet)
        except (av.error.FFmpegError, ValueError):
            log.warning("the sound of %s (%s) is left out: an MP4 cannot hold it", source, sound.codec.name)


def log_omitted_tracks(container: Any, source: Path) -> None:
    """Log how many additional sound tracks and subtitles are not copied into the painted film."""
    tracks = {"sound": max(0, len(container.streams.audio) - 1), "subtitles": len(container.streams.subtitles)}
    if left := ", ".join(f"{count} of {name}" for name, count in tracks.items() if count):
        cure = "add them with: ffmpeg -i film.mp4 -i source -map 0 -map 1:a:1 -map 1:s? -c copy out.mkv"
        log.warning("the first sound track of %s is kept; further tracks are left out (%s); %s", source, left, cure)


def _packets(container: Any, stream: Any, into: Any, start: Fraction, end: Fraction | float) -> Iterator[Any]:
    """Yield a stream's packets between two times in seconds, reassigned to another stream and shifted to start at 0."""
    before = round(start / stream.time_base)
    for packet in container.demux(stream):
        if packet.pts is not None and start <= packet.pts * packet.time_base < end:
            packet.pts, packet.dts, packet.stream = packet.pts - before, packet.dts - before, into
            yield packet
