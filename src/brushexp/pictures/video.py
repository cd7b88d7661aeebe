"""Write films frame by frame: videos immediately, GIFs at the end."""

import importlib
import logging
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from fractions import Fraction
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np
from PIL import Image

from brushexp.system.files import replacing

log = logging.getLogger(__name__)
MOST_FPS = 50  # players show faster GIFs slowly
MOST_SECONDS = 300  # maximum duration of a film; its last picture may stay as long again
LARGEST_SIDE = 4096  # pixels; limit of H.264 players
# On canvases of this size, slower presets save little; with mbtree, small films differ between encodings.
X264 = {"crf": "19", "preset": "veryfast", "x264-params": "mbtree=0"}
FAST_START = {"movflags": "faststart"}
IN_ORDER = {"bf": "0"}  # readers sum durations incorrectly if pictures have different durations and are out of order
BT709 = 1  # FFmpeg's number for the usual colour space of video and its usual range of values
GIF_SIDE = 480  # pixels; larger GIFs take many megabytes
GIF_TOLERANCE = 6  # levels of 255; a pixel that changes by no more keeps its displayed value
KEEP = 1  # GIF's number for "keep this frame; the next one is drawn over it"

Array = np.ndarray
Show = Callable[[Array, int], None]  # arguments: a picture (H, W, 3) of bytes, and its duration in ticks


class Film(NamedTuple):
    """The path of a film and the function that adds a frame to it."""

    path: Path
    show: Show


@contextmanager
def filming(
    stem: Path, kind: str, size: tuple[int, int], rate: Fraction, *, usual: Fraction | None = None, begin: int = 0
) -> Iterator[Film]:
    """Write a film to ``stem`` plus a suffix, as mp4 or gif; without PyAV, a GIF replaces the video.

    If the height or width (``size``) of a video is odd, its last row or column is repeated; a GIF is downsampled to at
    most ``GIF_SIDE`` pixels. ``rate`` is in ticks per second, at most ``MOST_FPS``, and a video repeats a frame that
    lasts several ticks. If a ``usual`` frame rate is given, a video stores each frame only once, with its own duration,
    so that ticks may be much shorter. A video shows the first frame at tick ``begin``. A UserError is raised if the
    file cannot be written.
    """
    av = _encoder(kind)
    if av is None and kind != "gif":
        log.info("%s becomes a GIF; for a video: pip install 'brushexp[video]'", stem.name)
    path = stem.with_name(f"{stem.name}.{'gif' if av is None else 'mp4'}")
    writing = _gif(path, rate) if av is None else _mp4(path, size, rate, usual, begin, av)
    with writing as show:
        yield Film(path, show)


def largest_side(kind: str) -> int:
    """Return the maximum length of a film's longer side, in pixels."""
    return GIF_SIDE if _encoder(kind) is None else LARGEST_SIDE


def _encoder(kind: str) -> ModuleType | None:
    """Return the PyAV module if this type of film is a video and PyAV has an H.264 encoder; otherwise None."""
    if kind == "gif":
        return None
    try:
        av = importlib.import_module("av")
    except ImportError:
        return None
    return av if "libx264" in av.codecs_available else None


@contextmanager
def _mp4(
    path: Path, size: tuple[int, int], rate: Fraction, usual: Fraction | None, begin: int, av: ModuleType
) -> Iterator[Show]:
    odd = [(0, side % 2) for side in size]  # H.264 stores colours in squares of 2 x 2 pixels
    with replacing(path) as temporary, av.open(str(temporary), "w", options=FAST_START) as container:
        stream = container.add_stream("libx264", rate=usual or rate, options=X264 | (IN_ORDER if usual else {}))
        stream.height, stream.width = (side + side % 2 for side in size)
        stream.pix_fmt = "yuv420p"
        coding = stream.codec_context  # declared in the file, because players make different guesses otherwise
        coding.colorspace = coding.color_primaries = coding.color_trc = coding.color_range = BT709
        coding.time_base = 1 / rate
        tick = begin
        stays: dict[int, int] = {}  # tick of a picture -> its duration, which the encoder forgets

        def mux(packets: Iterable[Any]) -> None:
            for packet in packets:
                packet.duration = stays.pop(packet.pts)
                container.mux(packet)

        def show(picture: Array, ticks: int) -> None:
            nonlocal tick
            frame = av.VideoFrame.from_ndarray(np.pad(picture, [*odd, (0, 0)], mode="edge"), format="rgb24")
            frame = frame.reformat(format="yuv420p", dst_colorspace="ITU709")
            for length in [1] * ticks if usual is None else [ticks]:
                frame.pts, frame.time_base, stays[tick] = tick, 1 / rate, length
                mux(stream.encode(frame))
                tick += length

        yield show
        mux(stream.encode())


@contextmanager
def _gif(path: Path, rate: Fraction) -> Iterator[Show]:
    """Write a GIF with only the changed pixels in each frame, which keeps the file small and avoids flicker."""
    frames: list[Image.Image] = []
    begins: list[int] = []  # starts of the frames, in ticks
    now = 0
    screen: Array = np.array(-1000)  # each pixel at its last change; initially unlike any colour

    def show(picture: Array, ticks: int) -> None:
        nonlocal now, screen
        small = Image.fromarray(picture)
        small.thumbnail((GIF_SIDE, GIF_SIDE), Image.Resampling.LANCZOS)
        levels = np.asarray(small).astype(np.int16)
        changed: Array = (np.abs(levels - screen) > GIF_TOLERANCE).any(2)
        if changed.any():
            screen = np.where(changed[..., None], levels, screen)
            frames.append(_cut_out(np.asarray(small), changed))
            begins.append(now)
        now += ticks

    yield show
    times = [10 * round(100 * tick / rate) for tick in [*begins, now]]  # GIF counts hundredths of a second
    lengths = np.diff(times).tolist()
    with replacing(path) as temporary:
        frames[0].save(
            temporary, "GIF", save_all=True, append_images=frames[1:], duration=lengths, loop=0, disposal=KEEP,
            optimize=False,
        )  # fmt: skip


def _cut_out(picture: Array, changed: Array) -> Image.Image:
    """Encode a picture's changed pixels with a palette of 255 colours, and make all other pixels transparent."""
    small = Image.fromarray(picture[changed][None]).quantize(255)
    palette = small.getpalette() or []
    index = np.full(changed.shape, len(palette) // 3, np.uint8)
    index[changed] = np.asarray(small)[0]
    image = Image.fromarray(index)
    image.putpalette([*palette, 0, 0, 0])
    image.info["transparency"] = len(palette) // 3
    return image
