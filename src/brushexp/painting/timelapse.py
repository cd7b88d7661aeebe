"""The painting as it came to be: a short video, a GIF, or both."""

from __future__ import annotations

import io
import math
from fractions import Fraction
from functools import lru_cache
from pathlib import Path
from typing import Any

import lightning as L
import numpy as np
import torch
from PIL import Image
from torch import Tensor
from torch.nn.functional import avg_pool2d

from brushexp.errors import UserError
from brushexp.painting.painter import Painter
from brushexp.pictures.video import LARGEST_SIDE, MOST_FPS, MOST_SECONDS, Format, filming
from brushexp.system.files import to_bytes

MAX_FRAMES = 2000  # each takes about 50 kB of memory
JPEG_QUALITY = 92
FPS = 15  # frames per second where no length is chosen
MIN_FPS = 10  # ticks per second: frames that last longer are repeated, because players seek badly in slow videos
HOLD_SECONDS = 1.5  # that the finished painting stays


class Timelapse:
    """Collects frames while strokes are optimised, compressed, and writes them as a film.

    Args:
        n_frames: about how many in all; 0 for no timelapse.
        side: longer side of a frame in pixels; smaller pictures are not enlarged.
        seconds: how long they take in all; None for ``FPS`` frames per second. The last one stays for ``HOLD_SECONDS``
            more.
        kind: which files.
    """

    def __init__(self, n_frames: int, side: int, *, seconds: float | None = None, kind: Format = Format.mp4) -> None:
        if not 0 <= n_frames <= MAX_FRAMES:
            raise UserError(f"frames is {n_frames}; choose 0 (no timelapse) to {MAX_FRAMES}")
        if not 2 <= side <= LARGEST_SIDE:
            raise UserError(f"frame_side is {side}; choose 2 to {LARGEST_SIDE} pixels")
        least = n_frames / MOST_FPS
        if seconds is not None and not least <= seconds <= MOST_SECONDS:
            choices = f"{least:g} to {MOST_SECONDS} for {n_frames} frames"
            raise UserError(f"timelapse_seconds is {seconds:g}; choose {choices}")
        self.n_frames = n_frames
        self.side = side
        self.seconds = seconds
        self.kind = kind
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

    def write(self, folder: Path) -> list[Path]:
        """Write ``timelapse.mp4`` (or ``.gif``, or both) and return the paths; none if there are no frames."""
        if not self._frames:
            return []
        *steps, last = sorted(self._frames)
        rate, ticks = timing(len(self._frames), self.seconds)
        painting = self._frame(last)
        with filming(folder / "timelapse", self.kind, painting.shape[:2], rate) as film:
            for step in steps:
                film.show(self._frame(step), ticks)
            film.show(painting, ticks + round(HOLD_SECONDS * rate))
        return film.paths

    def _frame(self, step: int) -> np.ndarray:
        """Bytes (H, W, 3)."""
        return np.asarray(Image.open(io.BytesIO(self._frames[step])).convert("RGB"))

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


class Frames(L.Callback):
    """Shows a timelapse the frames it wants, and keeps them in the checkpoint."""

    def __init__(self, timelapse: Timelapse) -> None:
        self.timelapse = timelapse

    def on_train_start(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        self.look(pl_module)

    def on_train_batch_end(self, trainer: L.Trainer, pl_module: L.LightningModule, *_: object) -> None:
        self.look(pl_module)

    def look(self, painter: L.LightningModule) -> None:
        """Offer the picture as it is now."""
        assert isinstance(painter, Painter)
        if self.timelapse.due(painter.schedule.step, painter.schedule.steps):
            self.timelapse.add(painter.latest(), painter.schedule.step)

    def state_dict(self) -> dict[str, Any]:
        return self.timelapse.state_dict()

    def load_state_dict(self, state_dict: dict[str, Any]) -> None:
        self.timelapse.load_state_dict(state_dict)


@lru_cache
def moments(n_frames: int, n_steps: int) -> frozenset[int]:
    """The steps to capture: first and last, and between them ever fewer, because most happens early.

    Frame k is that of step n_steps * (k / (n_frames - 1))², but never closer than one step to the frame before.
    """
    last = max(n_frames - 1, 1)
    if n_steps <= last:
        return frozenset(range(n_steps + 1))
    return frozenset(max(k, round(n_steps * (k / last) ** 2)) for k in range(last + 1))


def timing(n_frames: int, seconds: float | None) -> tuple[Fraction, int]:
    """Ticks per second of a film, and how many of them each of its frames lasts, so that all take ``seconds``."""
    if seconds is None:
        return Fraction(FPS), 1
    ticks = math.ceil(MIN_FPS * seconds / n_frames)
    rate = ticks * n_frames / Fraction(seconds).limit_denominator(1000)
    return min(rate, Fraction(MOST_FPS)), ticks  # runs of a given time may have some frames more than was asked for


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
