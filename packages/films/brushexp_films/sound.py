"""The sound of a film is copied to the painted one."""

import heapq
import importlib
import logging
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from brushexp.pictures.video import FAST_START
from brushexp.system.files import replacing

log = logging.getLogger(__name__)


def add_sound(film: Path, source: Path, start: float = 0.0) -> None:
    """Copy the sound of another film, from the second ``start`` on and for as long as the pictures go, into an MP4.

    Sound of a kind that an MP4 cannot hold is left out, and the log says so.
    """
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
