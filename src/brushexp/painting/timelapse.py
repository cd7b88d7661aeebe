"""Record a painting in progress as a short video or GIF."""

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
from torch.nn.functional import interpolate

from brushexp.errors import UserError
from brushexp.pictures.video import MOST_FPS, MOST_SECONDS, filming
from brushexp.system.files import to_bytes

JPEG_QUALITY = 92
FPS = 15  # frames per second if no duration is chosen
MIN_FPS = 10  # minimum frames per second: slower frames are repeated, because players seek badly in slow videos
HOLD_SECONDS = 1.5  # seconds for which the finished painting is shown


class Timelapse(L.Callback):
    """Collects compressed frames during the steps, stores them in checkpoints, and turns them into a film.

    About ``n_frames`` frames of at most ``side`` pixels are shown for ``seconds`` in total, or at ``FPS`` frames per
    second if ``seconds`` is None; then the last frame is held for ``HOLD_SECONDS``.
    """

    def __init__(self, n_frames: int, side: int, *, seconds: float | None = None, kind: str = "mp4") -> None:
        least = n_frames / MOST_FPS
        if seconds is not None and not least <= seconds <= MOST_SECONDS:
            choices = f"{least:g} to {MOST_SECONDS} for {n_frames} frames"
            raise UserError(f"timelapse_seconds={seconds:g} does not fit; choose {choices}")
        self.n_frames, self.side, self.seconds, self.kind = n_frames, side, seconds, kind
        self.frames: dict[int, bytes] = {}  # step -> JPEG
        self._step = -1  # last step whose picture was considered

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in vars(self).items() if not callable(value)}  # Lightning adds methods

    def on_train_start(self, trainer: L.Trainer, painter: Any) -> None:
        self._step = painter.schedule.step - 1
        self.on_train_batch_end(trainer, painter)

    def on_train_batch_end(self, trainer: L.Trainer, painter: Any, *_: object) -> None:
        schedule, before = painter.schedule, self._step
        self._step = schedule.step
        steps = range(before + 1, schedule.step + 1)  # some painters take many steps between two states
        if self.n_frames and not moments(self.n_frames, schedule.steps).isdisjoint(steps):
            self.add(painter.latest(), schedule.step)

    def add(self, image: Tensor, step: int) -> None:
        """Store a picture (3, H, W) in [0, 1] as a frame; a second picture of the same step replaces the first."""
        if self.n_frames:
            encoded = io.BytesIO()
            shrink(image, self.side).save(encoded, format="JPEG", quality=JPEG_QUALITY)
            self.frames[step] = encoded.getvalue()

    def write(self, folder: Path) -> Path | None:
        """Write ``timelapse.mp4`` or ``timelapse.gif`` and return its path, or None if there are no frames."""
        if not self.frames:
            return None
        *steps, last = sorted(self.frames)
        rate, ticks = choose_ticks(len(self.frames), self.seconds)
        painting = self._frame(last)
        with filming(folder / "timelapse", self.kind, painting.shape[:2], rate) as film:
            for step in steps:
                film.show(self._frame(step), ticks)
            film.show(painting, ticks + round(HOLD_SECONDS * rate))
        return film.path

    def _frame(self, step: int) -> np.ndarray:
        return np.asarray(Image.open(io.BytesIO(self.frames[step])).convert("RGB"))

    def state_dict(self) -> dict[str, Any]:
        frames = [torch.frombuffer(bytearray(jpeg), dtype=torch.uint8) for jpeg in self.frames.values()]
        return {"steps": list(self.frames), "frames": frames}

    def load_state_dict(self, state_dict: dict[str, Any]) -> None:
        jpegs = [frame.numpy().tobytes() for frame in state_dict["frames"]]
        self.frames = dict(zip(state_dict["steps"], jpegs, strict=True))


@lru_cache
def moments(n_frames: int, n_steps: int) -> frozenset[int]:
    """Choose the steps to capture: frame k is step n_steps * (k / (n_frames - 1))², or step k if that is later."""
    last = max(n_frames - 1, 1)
    if n_steps <= last:
        return frozenset(range(n_steps + 1))
    return frozenset(max(k, round(n_steps * (k / last) ** 2)) for k in range(last + 1))


def choose_ticks(n_frames: int, seconds: float | None) -> tuple[Fraction, int]:
    """Compute the ticks per second and the ticks per frame of a film that lasts ``seconds`` in total."""
    if seconds is None:
        return Fraction(FPS), 1
    ticks = math.ceil(MIN_FPS * seconds / n_frames)
    rate = ticks * n_frames / Fraction(seconds).limit_denominator(1000)
    return min(rate, Fraction(MOST_FPS)), ticks  # a run with a time limit may have some more frames


def shrink(image: Tensor, side: int) -> Image.Image:
    """Shrink a picture (3, H, W) to at most ``side`` pixels on its longer side."""
    height, width = image.shape[1:]
    zoom = min(1.0, side / max(height, width))
    size = (max(1, round(height * zoom)), max(1, round(width * zoom)))
    return Image.fromarray(to_bytes(interpolate(image.detach()[None], size, mode="bilinear", antialias=True)[0]))
