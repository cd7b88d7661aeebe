"""The painting as it came to be: a short video, or a GIF where PyAV is not installed."""

from __future__ import annotations

import importlib
import io
import logging
from functools import lru_cache
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import torch
from PIL import Image
from torch import Tensor
from torch.nn.functional import avg_pool2d

from brushexp.errors import UserError
from brushexp.files import replacing, to_bytes, write_bytes

log = logging.getLogger(__name__)
MOST_FRAMES = 2000  # each takes about 50 kB of memory
LARGEST_SIDE = 4096  # pixels: what players of H.264 take
JPEG_QUALITY = 92
FPS = 15
HOLD = 1.5  # seconds that the finished painting stays
X264 = {"crf": "18", "preset": "veryfast"}  # on canvases of this size slower presets save little
BT709 = 1  # FFmpeg's number for the usual colour space of video, and for its usual range of values
GIF_SIDE = 320  # pixels: keeps a GIF of 60 frames below some megabytes
GIF_COLORS = 256


class Timelapse:
    """Collects frames while strokes are optimised, compressed, and writes them as a video.

    Args:
        n_frames: about how many in all; 0 for no timelapse.
        side: longer side of a frame in pixels; smaller pictures are not enlarged.
    """

    def __init__(self, n_frames: int, side: int) -> None:
        if not 0 <= n_frames <= MOST_FRAMES:
            raise UserError(f"frames is {n_frames}; choose 0 (no timelapse) to {MOST_FRAMES}")
        if not 2 <= side <= LARGEST_SIDE:
            raise UserError(f"frame_side is {side}; choose 2 to {LARGEST_SIDE} pixels")
        self.n_frames = n_frames
        self.side = side
        self._frames: dict[int, bytes] = {}  # step -> JPEG

    def due(self, step: int, n_steps: int) -> bool:
        """Whether the picture after this step belongs in the timelapse."""
        return self.n_frames > 0 and step in moments(self.n_frames, n_steps)

    def add(self, image: Tensor, step: int) -> None:
        """Keep a picture (3, H, W) in [0, 1]; a second one of the same step takes the place of the first."""
        if self.n_frames:
            encoded = io.BytesIO()
            shrink(image, self.side).save(encoded, format="JPEG", quality=JPEG_QUALITY)
            self._frames[step] = encoded.getvalue()

    def write(self, folder: Path) -> Path | None:
        """Write ``timelapse.mp4`` (or ``.gif``) and return its path; None if there are no frames."""
        if not self._frames:
            return None
        frames = [Image.open(io.BytesIO(self._frames[step])).convert("RGB") for step in sorted(self._frames)]
        av = _video_library()
        if av is None:
            log.info("the timelapse becomes a GIF; for a video: pip install av")
            return _write_gif(folder / "timelapse.gif", frames)
        return _write_video(folder / "timelapse.mp4", frames, av)

    def state_dict(self) -> dict[str, Any]:
        """All frames, as tensors of bytes, for a checkpoint."""
        return {
            "steps": list(self._frames),
            "frames": [torch.frombuffer(bytearray(jpeg), dtype=torch.uint8) for jpeg in self._frames.values()],
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Take over the frames of `state_dict`."""
        jpegs = [frame.numpy().tobytes() for frame in state["frames"]]
        self._frames = dict(zip(state["steps"], jpegs, strict=True))


@lru_cache
def moments(n_frames: int, n_steps: int) -> frozenset[int]:
    """The steps to capture: first and last, and between them ever fewer, because most happens early.

    Frame k is that of step n_steps * (k / (n_frames - 1))², but never closer than one step to the frame before.
    """
    last = max(n_frames - 1, 1)
    if n_steps <= last:
        return frozenset(range(n_steps + 1))
    return frozenset(max(k, round(n_steps * (k / last) ** 2)) for k in range(last + 1))


def shrink(image: Tensor, side: int) -> Image.Image:
    """Scale a picture (3, H, W) to at most ``side`` pixels and to an even height and width, as video needs."""
    height, width = image.shape[1:]
    zoom = min(1.0, side / max(height, width))
    size = (_even(width * zoom), _even(height * zoom))
    whole = max(1, min(int(0.5 / zoom), height, width))  # coarse reduction first: a large picture costs little
    if whole > 1:
        image = avg_pool2d(image.detach()[None], whole)[0]
    picture = Image.fromarray(to_bytes(image))
    return picture if picture.size == size else picture.resize(size, Image.Resampling.LANCZOS)


def _even(length: float) -> int:
    return max(2, int(length) // 2 * 2)


def _video_library() -> ModuleType | None:
    """PyAV, if it is installed and has an encoder for H.264."""
    try:
        av = importlib.import_module("av")
    except ImportError:
        return None
    return av if "libx264" in av.codecs_available else None


def _write_video(path: Path, frames: list[Image.Image], av: ModuleType) -> Path:
    with replacing(path) as temporary, av.open(str(temporary), "w", options={"movflags": "faststart"}) as container:
        stream = container.add_stream("libx264", rate=FPS, options=X264)
        stream.width, stream.height = frames[-1].size
        stream.pix_fmt = "yuv420p"
        coding = stream.codec_context  # said in the file, because players guess differently where it is not
        coding.colorspace = coding.color_primaries = coding.color_trc = coding.color_range = BT709
        for frame in [*frames, *[frames[-1]] * round(HOLD * FPS)]:
            picture = av.VideoFrame.from_image(frame).reformat(format="yuv420p", dst_colorspace="ITU709")
            container.mux(stream.encode(picture))
        container.mux(stream.encode())
    return path


def _write_gif(path: Path, frames: list[Image.Image]) -> Path:
    for frame in frames:
        frame.thumbnail((GIF_SIDE, GIF_SIDE))
    samples = [*frames[:: len(frames) // 8 + 1], frames[-1]]  # one palette for all, or still parts would flicker
    palette = Image.fromarray(np.hstack([np.asarray(frame) for frame in samples])).quantize(GIF_COLORS)
    first, *others = (frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames)
    durations = [round(1000 / FPS)] * len(others) + [round(1000 * HOLD)]
    encoded = io.BytesIO()
    first.save(encoded, format="GIF", save_all=True, append_images=others, duration=durations, loop=0)
    write_bytes(path, encoded.getvalue())
    return path
