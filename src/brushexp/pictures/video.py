"""Films as MP4 and GIF, written picture by picture, so that a long one takes no more memory than a short one."""

from __future__ import annotations

import importlib
import logging
import struct
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from enum import Enum
from fractions import Fraction
from pathlib import Path
from types import ModuleType
from typing import BinaryIO

import numpy as np
from PIL import GifImagePlugin, Image

from brushexp.errors import UserError
from brushexp.system.files import replacing

log = logging.getLogger(__name__)
MOST_FPS = 50  # players show GIFs that are faster than this slowly
MOST_SECONDS = 300  # of a film; its last picture may stay as long again
LARGEST_SIDE = 4096  # pixels: what players of H.264 take
X264 = {"crf": "18", "preset": "veryfast"}  # on canvases of this size slower presets save little
BT709 = 1  # FFmpeg's number for the usual colour space of video, and for its usual range of values
GIF_SIDE = 480  # pixels: larger GIFs take many megabytes
GIF_COLORS = 255  # of one frame, besides the transparent one
SAME = 6  # levels of 255: a pixel of a GIF that changes by no more than this stays as it is shown
KEEP = 1  # GIF's number for "leave this frame where it is; the next one is laid over it"
FOREVER = b"!\xff\x0bNETSCAPE2.0\x03\x01\x00\x00\x00"  # extension of GIF: play it again and again

Array = np.ndarray
Show = Callable[[Array, int], None]  # a picture (H, W, 3) of bytes, and for how many ticks it stays


class Format(Enum):
    """Of a film: a video, which is small and sharp; an animated picture, which plays in every page; or both."""

    mp4 = "mp4"
    gif = "gif"
    both = "both"


@dataclass(frozen=True)
class Film:
    """A film that is being written.

    Attributes:
        paths: its files, which are there when it is finished.
        show: adds a picture.
    """

    paths: list[Path]
    show: Show


@contextmanager
def filming(stem: Path, kind: Format, size: tuple[int, int], rate: Fraction) -> Iterator[Film]:
    """Write ``stem`` with .mp4, .gif or both behind it; where PyAV is missing, a GIF takes the place of the video.

    Args:
        stem: folder and name without suffix.
        kind: which files.
        size: height and width of the pictures. A video whose sides are odd repeats its last row or column, and a GIF
            is shrunk to at most ``GIF_SIDE`` pixels.
        rate: ticks per second, at most ``MOST_FPS``.

    Raises:
        UserError: if a file cannot be written.
    """
    av = _encoder(kind)
    if av is None and kind is not Format.gif:
        log.info("%s becomes a GIF; for a video: pip install av", stem.name)
    with ExitStack() as opened:
        paths, shows = [], []
        if av is not None:
            paths.append(stem.with_name(f"{stem.name}.mp4"))
            shows.append(opened.enter_context(_mp4(paths[-1], size, rate, av)))
        if av is None or kind is Format.both:
            paths.append(stem.with_name(f"{stem.name}.gif"))
            shows.append(opened.enter_context(_gif(paths[-1], size, rate)))

        def show(picture: Array, ticks: int) -> None:
            for each in shows:
                each(picture, ticks)

        yield Film(paths, show)


def largest_side(kind: Format) -> int:
    """Pixels that the longer side of a film has at most."""
    return GIF_SIDE if _encoder(kind) is None else LARGEST_SIDE


def format_of(name: str, key: str) -> Format:
    """The format that a config calls ``name``.

    Raises:
        UserError: if there is none; it names the ``key`` and those that there are.
    """
    if name not in Format.__members__:
        raise UserError(f"{key}={name} is not a kind of film; choose {', '.join(Format.__members__)}")
    return Format[name]


def _encoder(kind: Format) -> ModuleType | None:
    """PyAV, if a film of this kind has a video, and PyAV is installed and has an encoder for H.264."""
    if kind is Format.gif:
        return None
    try:
        av = importlib.import_module("av")
    except ImportError:
        return None
    return av if "libx264" in av.codecs_available else None


@contextmanager
def _mp4(path: Path, size: tuple[int, int], rate: Fraction, av: ModuleType) -> Iterator[Show]:
    odd = [(0, side % 2) for side in size]  # the colours of H.264 come in squares of two pixels
    with replacing(path) as temporary, av.open(str(temporary), "w", options={"movflags": "faststart"}) as container:
        stream = container.add_stream("libx264", rate=rate, options=X264)
        stream.height, stream.width = (side + side % 2 for side in size)
        stream.pix_fmt = "yuv420p"
        coding = stream.codec_context  # said in the file, because players guess differently where it is not
        coding.colorspace = coding.color_primaries = coding.color_trc = coding.color_range = BT709
        shown = 0

        def show(picture: Array, ticks: int) -> None:
            nonlocal shown
            frame = av.VideoFrame.from_ndarray(np.pad(picture, [*odd, (0, 0)], mode="edge"), format="rgb24")
            frame = frame.reformat(format="yuv420p", dst_colorspace="ITU709")
            for _ in range(ticks):
                frame.pts, frame.time_base = shown, 1 / rate
                container.mux(stream.encode(frame))
                shown += 1

        yield show
        container.mux(stream.encode())


@contextmanager
def _gif(path: Path, size: tuple[int, int], rate: Fraction) -> Iterator[Show]:
    zoom = min(1.0, GIF_SIDE / max(size))
    height, width = (max(1, round(side * zoom)) for side in size)
    with replacing(path) as temporary, temporary.open("wb") as file:
        file.write(b"GIF89a" + struct.pack("<HHBBB", width, height, 0x70, 0, 0) + FOREVER)
        frames = _Changes(file, rate)

        def show(picture: Array, ticks: int) -> None:
            if picture.shape[:2] != (height, width):
                small = Image.fromarray(picture).resize((width, height), Image.Resampling.LANCZOS, reducing_gap=2)
                picture = np.asarray(small)
            frames.show(picture, ticks)

        yield show
        frames.finish()
        file.write(b";")


class _Changes:
    """Frames of a GIF that hold only the pixels which have changed, each with a palette of its own.

    A pixel that stays the same is transparent, which costs next to nothing, keeps its colour from flickering, and
    leaves the whole palette to those that are new.

    Args:
        file: takes the frames.
        rate: ticks per second.
    """

    def __init__(self, file: BinaryIO, rate: Fraction) -> None:
        self.file = file
        self.rate = rate
        self.shown: Array | None = None  # (H, W, 3) int16: each pixel as it was when it was last written
        self.frame: tuple[Image.Image, tuple[int, int], int] | None = None  # is written when its end is known
        self.ticks = 0  # so far
        self.begin = 0  # of that frame, in GIF's hundredths of a second

    def show(self, picture: Array, ticks: int) -> None:
        levels = picture.astype(np.int16)
        if self.shown is None:
            self.shown, changed = levels.copy(), np.ones(levels.shape[:2], bool)
        else:
            changed = (np.abs(levels - self.shown) > SAME).any(2)
        if changed.any():
            self.finish()
            self.shown[changed] = levels[changed]
            self.frame = _cut_out(picture, changed)
        self.ticks += ticks

    def finish(self) -> None:
        """Write the frame that waits, if there is one: it lasts until now."""
        if self.frame is None:
            return
        image, place, transparent = self.frame
        end = round(100 * self.ticks / self.rate)
        data = GifImagePlugin.getdata(
            image, place, duration=10 * (end - self.begin), transparency=transparent, disposal=KEEP,
            include_color_table=True,
        )  # fmt: skip
        self.file.writelines(data)
        self.frame, self.begin = None, end


def _cut_out(picture: Array, changed: Array) -> tuple[Image.Image, tuple[int, int], int]:
    """The box around some pixels of a picture, with a palette for them and everything else transparent.

    Returns:
        The box, where its upper left corner lies (x, y), and its transparent colour.
    """
    rows, columns = np.flatnonzero(changed.any(1)), np.flatnonzero(changed.any(0))
    box = np.s_[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    found = Image.fromarray(picture[changed][None]).quantize(GIF_COLORS)
    assert found.palette is not None
    palette = bytes(found.palette.palette)
    transparent = len(palette) // 3
    index = np.full(changed[box].shape, transparent, np.uint8)
    index[changed[box]] = np.asarray(found)[0]
    image = Image.fromarray(index)
    image.putpalette(palette + bytes(3))
    return image, (int(columns[0]), int(rows[0])), transparent
